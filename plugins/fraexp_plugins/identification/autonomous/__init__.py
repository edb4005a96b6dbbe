"""Plant and friction together, from frequency response records only."""

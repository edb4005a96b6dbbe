"""Plant and friction from whole records: every sample counts, not the spectral lines alone."""

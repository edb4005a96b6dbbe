"""What tuning consists of: the band of plants, describing functions, margins, limit cycles, search; no component."""

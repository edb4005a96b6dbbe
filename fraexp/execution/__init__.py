"""Running studies: jobs, workers, events, and how long it will take."""

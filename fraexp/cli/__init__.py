"""The command line: data go to stdout, messages to stderr, and the exit code reports the outcome."""

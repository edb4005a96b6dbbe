"""What the store holds, as people read it: words, fields and tables for the command line and the terminal UI."""

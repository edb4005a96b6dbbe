"""Texts, fields and tables that show stored runs, sweeps and results on the command line and in the terminal UI."""

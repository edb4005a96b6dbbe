"""The databases that the store can be: SQLite files and PostgreSQL servers."""

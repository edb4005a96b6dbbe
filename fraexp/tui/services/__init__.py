"""What screens ask and rely on: the database, settings, keys, watches."""

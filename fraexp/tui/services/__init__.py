"""Services of the screens: database access, settings, keys, and watches."""

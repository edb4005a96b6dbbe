"""Services of the screens: database access, keys, and watches."""

"""What screens are made of: tables, forms, lines to type in."""

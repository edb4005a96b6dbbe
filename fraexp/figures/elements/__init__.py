"""What figures are made of: the look, lines, labels, tables."""

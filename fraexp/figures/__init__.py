"""Figures: data → info (plain numbers) → matplotlib axes; only `canvas` and what draws import matplotlib."""

"""Built-in tuning: feedback gains from an identified plant, with margins for all plants of its band."""

"""What estimators stand on: spectra, responses, delays, confidence."""

"""The mathematics that estimators share: Fourier sums, responses, delays, confidence."""

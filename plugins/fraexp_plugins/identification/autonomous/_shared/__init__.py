"""Helpers of the joint identification: spectral lines, friction elements, the plant."""

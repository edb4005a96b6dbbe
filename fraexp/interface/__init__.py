"""The Python interface: what notebooks and scripts reach through ``import fraexp``."""

"""The paper's closed loop, simulated by other packages and by programs that a user could write by hand."""

"""Built-in positioning: motions with their feedforward, and what became of them."""

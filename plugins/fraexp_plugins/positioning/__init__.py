"""Built-in positioning: motions with their feedforward, and the metrics of moves."""

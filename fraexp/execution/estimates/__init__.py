"""How long a run will take: its work, counted, at the speed that this machine has shown."""

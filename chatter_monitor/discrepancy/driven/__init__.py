"""A machine whose force was recorded, too: its force balance, and what is said of it."""

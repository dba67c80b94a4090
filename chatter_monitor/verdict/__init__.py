"""From operational dynamic parameters to a state that an operator can trust."""

"""Pictures of what a person sees, made from real replays without a screen."""

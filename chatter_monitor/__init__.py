"""Chatter monitor for machine tools: operational damping and frequency at every sample, and what they mean."""

"""The concealed-physics proof: cases from a blind generator, a sealed key, and the score of `diagnose` on them."""

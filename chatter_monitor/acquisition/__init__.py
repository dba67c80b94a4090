"""Where samples come from: recordings, sound cards, synthetic signals; resampling and the ring between threads."""

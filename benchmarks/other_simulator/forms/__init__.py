"""Forms of the effects, by family."""

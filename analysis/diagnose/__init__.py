"""From residuals to a verdict: what the plain model gets wrong, which catalogued effects explain it, what is left,
what it gains."""

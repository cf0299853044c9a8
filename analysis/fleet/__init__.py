"""Many sensors of one type: their population, each sensor beside it, and the population as a prior for the next."""

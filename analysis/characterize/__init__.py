"""Alpha of a bead and D(T) of a film from one campaign, with or without named effects in the model."""

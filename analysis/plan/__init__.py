"""The decision after each look: what is known and tied by now, what to record next, when to stop; and flights."""

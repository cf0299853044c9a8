"""The virtual bench: emulated instruments over one physical world that knows the truth. It imports no driver."""

"""What to record next: goals, the runs that a bench can make, what each is worth per minute, and when to stop."""

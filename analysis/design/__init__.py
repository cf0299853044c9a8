"""What a run that has not been made would bring, and which to record next: for a diagnosis and for goals alike."""

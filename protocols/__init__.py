"""What a person does: procedures that put the rig and the analysis together, and the command line."""

"""Watching a campaign from its folder alone: whoever watches can die, or come late, without harm to the run."""

"""What nobody listed: what is left without any form, and the behaviour that describes it best."""

"""What recordings mean: models, fits, diagnosis, correction. Pure: no hardware, no clock."""

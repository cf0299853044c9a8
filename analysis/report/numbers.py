"""Numbers as a person writes them; they stand with the formats, which show themselves as well."""

from shockrig.files.numbers import between, counted, measured, plain, power_of_ten

__all__ = ["between", "counted", "measured", "plain", "power_of_ten"]

"""The verdict as a table: what was found and what is left, and what is said."""

import pytest

from shockrig.analysis.diagnose.verdict import Standing, verdict

LEFT = {"left_over": True, "matters": True}


@pytest.mark.parametrize(
    ("standing", "said"),
    [
        # Nothing is left, or nothing that matters.
        (Standing(), "adequate"),
        (Standing(left_over=True), "adequate"),
        (Standing(matters=True), "adequate"),
        (Standing(named=1), "explained"),
        (Standing(named=3, left_over=True), "explained"),
        (Standing(forms=1), "described"),
        (Standing(named=2, forms=1), "described"),
        (Standing(shown=1), "described"),
        (Standing(named=1, shown=1), "described"),
        # What is left and matters.
        (Standing(**LEFT), "unexplained"),
        (Standing(named=1, **LEFT), "unexplained"),
        (Standing(forms=1, **LEFT), "unexplained"),
        (Standing(shown=1, **LEFT), "unexplained"),
        # The input says that the runs fall into groups.
        (Standing(parted=True), "unexplained"),
        (Standing(named=2, parted=True), "unexplained"),
        (Standing(shown=1, parted=True), "unexplained"),
        (Standing(forms=1, parted=True), "described"),
        (Standing(forms=1, parted=True, **LEFT), "unexplained"),
        # One run: a shape that no other run has borne out explains nothing; nothing to explain is adequate.
        (Standing(named=1, borne_out=False, claims=False), "unexplained"),
        (Standing(named=1, borne_out=False), "explained"),
        (Standing(borne_out=False, claims=False), "adequate"),
        (Standing(named=1, claims=False), "explained"),
    ],
)
def test_a_verdict_is_a_function_of_where_a_channel_stands(standing, said):
    assert verdict(standing) == said

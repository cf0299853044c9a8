"""The verdict as a table: what was found and what is left, and what is said."""

import pytest

from shockrig.analysis.diagnose.verdict import Standing, verdict


@pytest.mark.parametrize(
    ("standing", "said"),
    [
        # Nothing is left that matters.
        (Standing(), "adequate"),
        (Standing(named=1), "explained"),
        (Standing(forms=1), "described"),
        (Standing(named=2, forms=1), "described"),
        (Standing(shown=1), "described"),
        (Standing(named=1, shown=1), "described"),
        # What is left and matters.
        (Standing(left_over=True), "unexplained"),
        (Standing(named=1, left_over=True), "unexplained"),
        (Standing(forms=1, left_over=True), "unexplained"),
        (Standing(shown=1, left_over=True), "unexplained"),
        # The input says that the runs fall into groups.
        (Standing(parted=True), "unexplained"),
        (Standing(named=2, parted=True), "unexplained"),
        (Standing(shown=1, parted=True), "unexplained"),
        (Standing(forms=1, parted=True), "described"),
        (Standing(forms=1, parted=True, left_over=True), "unexplained"),
        # One run: a shape that no other run has borne out explains nothing; nothing to explain is adequate.
        (Standing(named=1, borne_out=False, claims=False), "unexplained"),
        (Standing(named=1, borne_out=False), "explained"),
        (Standing(borne_out=False, claims=False), "adequate"),
        (Standing(named=1, claims=False), "explained"),
    ],
)
def test_a_verdict_is_a_function_of_where_a_channel_stands(standing, said):
    assert verdict(standing) == said

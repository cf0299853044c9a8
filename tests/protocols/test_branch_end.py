"""A process that has been branched off ends, also where a first request to end came to nothing."""

import time

from shockrig.protocols.branch import branch, received


def deaf_once(send):
    """Swallows the first exception that a signal raises, as a deletion does in the middle of which it is raised."""
    try:
        send("begun")
        time.sleep(3600)
    except SystemExit:
        time.sleep(3600)


def test_a_branch_that_does_not_hear_at_once_is_asked_again():
    with branch(deaf_once) as connection:
        assert received(connection) == "begun"

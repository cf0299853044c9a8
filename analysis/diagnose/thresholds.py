"""The numbers on which it hangs what a diagnosis says, and that cannot be derived, in one table, with what they mean.

`benchmarks/sensitivity.py` halves and doubles each of them in turn, as it does constants of any module, and prints what
becomes of verdicts.
"""

THRESHOLDS = {
    "effect": 4.5,  # nats against any further effect: what the best of the catalogue gains by chance
    "form": 1.5,  # nats against a form of the grammar beside an entry of the catalogue
    "factor": 2.5,  # nats against each condition that a form's strength depends on
    "tie": 0.05,  # share of the likeliest model's weight from which on another is tied with it
    "named": 0.75,  # probability of one effect more from which on it is stated: a wrong name costs three
    "adequacy": 1e-6,  # probability below which what is left is no accident
    "drift_scatter": 0.001,  # of airs that nobody recorded, in steps: what is not worth a word
    "rate_scatter": 0.022,  # scatter of the runs' rates that is an effect
    "stated_scatter": 1.7,  # by how much stated uncertainties may be exceeded
    "held_out_excess": 2.0,  # multiple of the noise that is no accident on unseen runs
    "average_gain": 6.0,  # drop in deviance of a running mean that noise hides
    "average_unlikely": 40.0,  # log-likelihood below which a length of a running mean is out
    "hidden_noise": 0.5,  # noise in steps that rounding hides
    "anything": 2.0,  # uncertainty, in its logarithm, of what may be anything
}


def level(name: str) -> float:
    """Value of an entry of the table."""
    return THRESHOLDS[name]

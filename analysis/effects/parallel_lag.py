"""A share of the response follows as a slow first-order lag: two time constants in parallel, whatever makes them."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Parameter, Start, Words

EFFECT = Effect(
    id="parallel_lag",
    link="body",
    channels=("temperature", "humidity"),
    equation="reading = (1 - fraction) body + fraction (1 - exp(-t / time_constant))",
    source="two exponentials; what makes the second one (support, housing, film, air) these runs do not say",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.9, (0.05, 0.3), percent=True),
        Parameter("time_constant_s", "s", 0.05, 3000.0, (3.0, 10.0, 50.0, 300.0), log=True, none=None),
    ),
    apply=lambda chain, p: replace(chain, lags=(*chain.lags, (p["fraction"], p["time_constant_s"][..., None]))),
    words=Words(
        "{fraction} of the response follows with a time constant of its own, {time_constant_s} s.",
        "Record the airflow and vary it: a support's share depends on it, a film's own does not.",
    ),
    needs=Needs(
        "is looked for in a single run and where the airflow was not recorded; its named causes are elsewhere",
        lambda channel: not channel.conditions.airflow_known.all() or channel.runs == 1,
    ),
    start=Start(mirrors=True),
    candidacy=Candidacy(shape=True),
    in_flight=InFlight(lag=lambda p: (p["fraction"], p["time_constant_s"])),
)

"""The sensing body has another shape than campaign.json says: one entry for each shape that it could have."""

from dataclasses import replace
from functools import cache

from shockrig.analysis.estimate.effect import Arrays, Candidacy, Effect, InFlight, Needs, Start, Words
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import Chain


@cache
def _t63(name: str) -> float:
    """Dimensionless time to 63 % of a step."""
    return BODIES[name].landmarks[0]


def _entry(name: str) -> Effect:
    body = BODIES[name]

    def with_body(chain: Chain, p: Arrays) -> Chain:
        return replace(chain, body=body)

    return Effect(
        id=f"body_{name}",
        link="body",
        channels=("temperature", "humidity"),
        equation=f"the closed form of {body.sentence}; its rate is {body.symbol}",
        source="Carslaw and Jaeger 1959, chapters 3, 7 and 9",
        parameters=(),
        apply=with_body,
        words=Words(
            f"The sensor responds like {body.sentence}, not like the body that is taken for it.",
            f'Set sensors.*.body to "{name}" in campaign.json if that is what the sensor is.',
        ),
        needs=Needs("is what campaign.json states already", lambda channel: channel.body != name),
        start=Start(rate_factor=lambda channel: _t63(name) / _t63(channel.body)),
        candidacy=Candidacy(
            rare=lambda channel: channel.known_sensor,
            # Around a lump a sheath cannot be told from a lag in series, which has one parameter less.
            excludes=frozenset(f"body_{other}" for other in BODIES if other != name)
            | ({"sheath"} if name == "lumped" else set()),
            shape=True,
        ),
        in_flight=InFlight(body=name),
    )


EFFECTS = tuple(_entry(name) for name in BODIES)

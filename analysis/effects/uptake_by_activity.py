"""The film takes up by the relative humidity at its own temperature, while that still follows the air's."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Readout, Start, Words

EFFECT = Effect(
    id="uptake_by_activity",
    link="readout",
    channels=("humidity",),
    equation="the film is driven by a = e / P_s(T_own), and shows what it has taken up; not by e, read at P_s(T)",
    source="a polymer's sorption isotherm: the activity of water sets what it takes up, and not its pressure",
    parameters=(),
    apply=lambda chain, p: replace(chain, by_activity=True),
    words=Words(
        (
            "The film takes up by the relative humidity at its own temperature: a sensor that is still warmer than the "
            "air dries first."
        ),
        "Use isothermal shocks for D(T), and log the sensor's own temperature: a thermometer on its chip has it.",
    ),
    needs=Needs(
        "is looked for in sensors whose films are not known, in runs whose temperature changes",
        lambda channel: not channel.known_sensor and bool((~channel.isothermal).any()),
    ),
    start=Start(own_rates=True, always=True),  # far from the plain film, whose rate then means little
    candidacy=Candidacy(excludes=frozenset({"die_thermal_lag", "concentration_dependent_diffusivity"}), shape=True),
    readout=Readout(thermal="thermal shocks, the film driven by the humidity at its own temperature"),
    in_flight=InFlight(at_die=True, activity=lambda p: 1.0),
)

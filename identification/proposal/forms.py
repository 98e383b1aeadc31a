"""The shapes of the grammar: how a force may depend on one variable that a site sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from identification.proposal.law import Constant
from identification.proposal.settings import ProposalSettings


class Quantity(NamedTuple):
    """A variable that a law reads.

    text : how its function reads it; symbol, latex : in formulas; word : in a sentence
    unit; typical : rms over the logs; smoothing : width of a sign of it
    """

    text: str
    symbol: str
    latex: str
    word: str
    unit: str
    typical: float
    smoothing: float = 0.0


@dataclass(frozen=True)
class Form:
    """One shape of a variable.

    Attributes
    ----------
    key : in names of laws; word : in a sentence
    constants : strengths and shape constants
    text, symbol, latex : the force, for a function and for people
    dissipative : whether it only takes energy, where the variable is the site's own speed
    odd : whether its sign is that of the variable
    """

    key: str
    word: str
    constants: tuple[Constant, ...]
    text: str
    symbol: str
    latex: str
    dissipative: bool = True
    odd: bool = True


UNITS = {
    ("N", "m/s"): ("N s/m", "N s^2/m^2", "N s^3/m^3"),
    ("N", "rad/s"): ("N s", "N s^2", "N s^3"),
    ("N m", "rad/s"): ("N m s", "N m s^2", "N m s^3"),
    ("N m", "m/s"): ("N s", "N s^2/m", "N s^3/m^2"),
    ("N", "m"): ("N/m", "N/m^2", "N/m^3"),
    ("N m", "rad"): ("N m/rad", "N m/rad^2", "N m/rad^3"),
    ("N m", "N m"): ("1", "1/(N m)", "1/(N m)^2"),
}
"""Units of a force over the first, second and third power of a variable."""


def strength(name: str, unit: str, u: Quantity, power: int) -> Constant:
    """A strength: a force over a power of a variable."""
    return Constant(name, UNITS[unit, u.unit][power - 1], size=u.typical**-power)


def speed_forms(u: Quantity, force: str, unit: str, settings: ProposalSettings) -> list[Form]:
    """Shapes of a speed.

    Parameters
    ----------
    force : name of the strength where it is a force or a torque of this ``unit``
    """
    x, s, t = u.text, u.symbol, u.latex
    eps = Constant("smoothing", u.unit, 1e-4 * u.typical, u.typical, u.smoothing,
                   (u.smoothing,), fitted=False)  # fmt: skip
    sign, sign_s = f"xp.tanh({x} / smoothing)", f"tanh({s}/eps)"
    sign_t = rf"\tanh({t}/\epsilon)"
    dry = Constant(force, unit)
    knees = tuple(share * u.typical for share in settings.knee_shares)
    knee = Constant("knee", u.unit, 0.02 * u.typical, 5 * u.typical, u.typical, knees)
    edge = Constant("edge", u.unit, 0.0, 4 * u.typical, u.typical, knees)
    peaks = tuple(share * u.typical for share in settings.peak_shares)
    peak = Constant("peak_speed", u.unit, 0.0, 4 * u.typical, u.typical, peaks)
    widths = tuple(share * u.typical for share in settings.width_shares)
    width = Constant("width", u.unit, 0.02 * u.typical, 4 * u.typical, u.typical, widths)
    slope, bend, cube = (strength("coefficient", unit, u, power) for power in (1, 2, 3))
    free = f"(xp.maximum({x} - edge, 0.0) + xp.minimum({x} + edge, 0.0))"
    at_peak = f"xp.exp(-(((xp.abs({x}) - peak_speed) / width) ** 2))"
    return [
        Form("dry", "dry", (dry, eps), f"{force} * {sign}", f"f {sign_s}", f"f {sign_t}"),
        Form("viscous", "viscous", (slope,), f"coefficient * {x}", f"k {s}", f"k {t}"),
        Form("quadratic", "quadratic", (bend,), f"coefficient * {x} * xp.abs({x})",
             f"k {s} |{s}|", f"k {t} |{t}|"),
        Form("cubic", "cubic", (cube,), f"coefficient * {x} ** 3", f"k {s}^3", f"k {t}^3"),
        Form("levelling", "levelling", (dry, knee), f"{force} * xp.tanh({x} / knee)",
             f"f tanh({s}/u_k)", rf"f \tanh({t}/u_k)"),
        Form("beyond_edge", "viscous (beyond a speed)", (slope, edge), f"coefficient * {free}",
             f"k ({s} beyond +-u_0)", rf"k\,\mathrm{{dz}}_{{u_0}}({t})"),
        Form("at_peak", "dry (around one speed)", (dry, peak, width, eps),
             f"{force} * {at_peak} * {sign}", f"f exp(-((|{s}| - u_p)/b)^2) {sign_s}",
             rf"f e^{{-((|{t}| - u_p)/b)^2}} {sign_t}"),
        Form("forward_dry", "one-way dry (forward)", (dry, eps),
             f"{force} * xp.maximum({sign}, 0.0)",
             f"f max({sign_s}, 0)", rf"f \max({sign_t}, 0)"),
        Form("backward_dry", "one-way dry (backward)", (dry, eps),
             f"{force} * xp.minimum({sign}, 0.0)",
             f"f min({sign_s}, 0)", rf"f \min({sign_t}, 0)"),
        Form("forward_viscous", "one-way viscous (forward)", (slope,),
             f"coefficient * xp.maximum({x}, 0.0)", f"k max({s}, 0)", rf"k \max({t}, 0)"),
        Form("backward_viscous", "one-way viscous (backward)", (slope,),
             f"coefficient * xp.minimum({x}, 0.0)", f"k min({s}, 0)", rf"k \min({t}, 0)"),
    ]  # fmt: skip


def even_forms(u: Quantity, force: str, unit: str) -> list[Form]:
    """Shapes of a speed that push the same way whichever way it goes."""
    x, s, t = u.text, u.symbol, u.latex
    slope, bend = (strength("coefficient", unit, u, power) for power in (1, 2))
    return [
        Form("absolute", "of the absolute", (slope,), f"coefficient * xp.abs({x})",
             f"k |{s}|", f"k |{t}|", dissipative=False, odd=False),
        Form("squared", "of the squared", (bend,), f"coefficient * {x} ** 2",
             f"k {s}^2", f"k {t}^2", dissipative=False, odd=False),
    ]  # fmt: skip

"""What effects may depend on: laws that no formula of theirs is, each within the functions of one basis set."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.effects.catalogue import load_catalogue
from tests.calibration.effects.general_functions import typical_inputs

CATALOGUE = load_catalogue()
LEAST = 0.98  # of the square of a law
# Any curve over time, or of speed and leg, explains nearly as much of these in a campaign as short as this one.
LEAST_OF_SLOW = {
    "column_thermal_growth": 0.999, "screw_thermal_growth": 0.999, "column_thermal_growth__mixture": 1.0 - 1e-8,
    "refraction__between_parts": 1.0 - 1e-8, "link_thermal_growth__two_heats": 1.0 - 1e-8,
    "screw_thermal_growth__two_heats": 1.0 - 1e-8, "axis_coupling__pushed": 1.0 - 1e-8,
    "drive_scale__creeping_belt": 1.0 - 1e-8, "drive_scale__warm_holder": 1.0 - 1e-8,
    "foundation_settling__curls": 1.0 - 1e-8, "tracker_drift__tripod": 1.0 - 1e-8,
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs():
    return typical_inputs()


@pytest.fixture(scope="module")
def long_inputs():
    """So many visits that no curve goes through all of them."""
    return typical_inputs(160)


def faded(inputs, left, tau_s: float) -> np.ndarray:
    """What each motion has left, each by itself dying away: the sum over all before a reading, written out."""
    arrived, t = inputs.context.history.arrived_s, inputs.context.t_s
    out = np.zeros(len(t))
    for reading, last in enumerate(inputs.context.arrival):
        since_s = np.maximum(t[reading] - arrived[: last + 1], 0.0)
        out[reading] = np.sum(left[: last + 1] * np.exp(-since_s / tau_s))
    return out


def moved_m(inputs, drive: int) -> np.ndarray:
    """Of each arrival, with its sign."""
    drives = inputs.context.history.drives[:, drive]
    return np.diff(drives, prepend=drives[0])


def speed_of_arrival(inputs) -> np.ndarray:
    out = np.zeros(len(inputs.context.history.arrived_s))
    for reading, arrival in enumerate(inputs.context.arrival):
        out[arrival] = inputs.context.speed_m_per_s[reading]
    return out


def latency(inputs):
    """A clock that goes wrong ever faster."""
    late = inputs.context.velocity_m_per_s * (inputs.context.elapsed_s[:, None] / 3600.0) ** 2
    return {f"travel.{inputs.drive(a)}": late[:, a] for a in range(2)}


def guide_straightness(inputs):
    """Play of a guide, wider at one end."""
    return {"sideways.left.x": inputs.context.direction[:, 0] * (1.0 + 0.5 * inputs.normalised_travel(0))}


def guide_straightness__warm_bed(inputs):
    """A bed that is warmer above bends its guide."""
    context = inputs.context
    warmer = np.mean(list(context.temperatures_c.values()), axis=0)
    bow = inputs.normalised_travel(0) ** 2 - 1.0 / 3.0
    return {"sideways.left.x": bow * (warmer - warmer.min())}


def guide_angular__runs_in(inputs):
    """A guide that wears where it is run."""
    travelled = np.cumsum(np.abs(np.diff(inputs.context.history.drives[:, 0], prepend=0.0)))[inputs.context.arrival]
    return {"turn.left.z": np.sin(2.0 * inputs.normalised_travel(0)) * np.sqrt(travelled)}


def guide_angular(inputs):
    return {"turn.left.z": inputs.context.direction[:, 0] * np.cos(2.0 * inputs.context.drives[:, 0])}


def link_stiffness(inputs):
    """Bolts that work loose."""
    return {"length.left_upper": inputs.tension_n[:, 0] * (1.0 - np.exp(-inputs.context.elapsed_s / 2000.0))}


def joint_clearance(inputs):
    """A pin that sinks through oil to where the strut's angle lets it."""
    sunk = 1.0 - np.exp(-inputs.context.dwell_s / 10.0)
    return {"length.left_upper": sunk * np.sin(2.5 * inputs.normalised_travel(0))}


def link_thermal_growth(inputs):
    """A joint's friction, with way and speed."""
    power = np.abs(moved_m(inputs, 0)) * speed_of_arrival(inputs)
    return {"length.left_upper": faded(inputs, power, 280.0)}


def column_thermal_growth(inputs):
    """The carriage's friction, with the way."""
    return {"travel.left": inputs.height_m(0) * faded(inputs, np.abs(moved_m(inputs, 0)), 600.0)}


def screw_thermal_growth(inputs):
    """A motor that is warmed by its starts warms the near end of the screw."""
    heat = faded(inputs, (moved_m(inputs, 0) != 0.0).astype(np.float64), 600.0)
    return {"travel.left": heat * (1.0 - inputs.normalised_travel(0)) ** 2}


def servo_settling(inputs):
    """An elastic after-effect."""
    return {"travel.left": -faded(inputs, moved_m(inputs, 0), 60.0)}


def payload(inputs):
    """Liquid that swings on after a stop."""
    context = inputs.context
    swing = np.exp(-context.dwell_s / 12.0) * np.cos(1.4 * context.dwell_s)
    mounted = (context.payload_kg > 0.0) / np.maximum(context.payload_kg, 1.0)
    channel = next(c for c in inputs.channels if c.startswith("payload.") and c != "payload.mass")
    return {channel: mounted * context.direction[:, 1] * context.speed_m_per_s * swing}


def payload__gathers(inputs):
    """What falls onto the platform stays there, whatever is mounted."""
    return {"payload.mass": 1.0 - np.exp(-inputs.context.elapsed_s / 1500.0)}


def payload__chain(inputs):
    """It lies on the floor but for what has been lifted."""
    lifted = scaled(inputs.context.drives[:, 0]) + scaled(inputs.context.drives[:, 1])
    return {"payload.mass": (inputs.context.payload_kg > 0.0) * lifted}


def link_stiffness__creeps(inputs):
    """A bond that yields the more, the longer it rests under load."""
    return {"length.left_upper": inputs.tension_n[:, 0] * (1.0 - np.exp(-inputs.context.dwell_s / 12.0))}


def servo_settling__pushed_out(inputs):
    """The payload pushes a drive out of place until the controller's integral action has brought it back."""
    return {"travel.left": inputs.context.payload_kg * np.exp(-inputs.context.dwell_s / 4.0)}


def tables_left_on(inputs):
    """A table that is multiplied by one of the other drive."""
    table = inputs.context.table_corrections_m(4, inputs.machine.drive_names, inputs.context.drives)[:, 0]
    return {"travel.left": table * inputs.normalised_travel(1)}


def screw_cumulative_error(inputs):
    """A pitch that wavers every few centimetres."""
    return {"travel.left": np.cos(np.pi * 25.0 * scaled(inputs.context.drives[:, 0]))}


def screw_periodic_error(inputs):
    """Balls that slip: the phase runs away with time."""
    q, t = inputs.context.drives[:, 0], inputs.context.elapsed_s
    ((period_m, _),) = inputs.periods(0, 4.0e-3, 6.0e-2)
    return {"travel.left": np.sin(2.0 * np.pi * q / period_m + 2.0 * t / t.max())}


def column_compliance(inputs):
    """A rail that is softer between its bolts."""
    force = inputs.pull_n[:, 0] @ np.array([1.0, 0.0, 0.0])
    return {"sideways.left.x": force * (1.0 + 0.6 * np.cos(np.pi * 8.0 * scaled(inputs.context.drives[:, 0])))}


def screw_thermal_growth__bearing(inputs):
    """The bearing at one end, whose friction grows with the speed's power of two thirds, warms the screw near it."""
    power = np.abs(moved_m(inputs, 0)) * speed_of_arrival(inputs) ** (2.0 / 3.0)
    along = np.exp(-1.5 * (1.0 + inputs.normalised_travel(0)))
    return {"travel.left": faded(inputs, power, 1500.0) * (1.0 - along)}


def link_thermal_growth__two_heats(inputs):
    """A joint by the way, and the strut, slowly, by the number of motions."""
    by_way = faded(inputs, np.abs(moved_m(inputs, 0)), 90.0)
    by_number = faded(inputs, (moved_m(inputs, 0) != 0.0).astype(np.float64), 4000.0)
    return {"length.left_upper": by_way / np.std(by_way) + by_number / np.std(by_number)}


def screw_thermal_growth__two_heats(inputs):
    """The screw along all of it by the way, and its upper end by starting and stopping."""
    by_way = faded(inputs, np.abs(moved_m(inputs, 0)), 600.0)
    by_number = faded(inputs, (moved_m(inputs, 0) != 0.0).astype(np.float64), 4000.0)
    u = inputs.normalised_travel(0)
    return {"travel.left": u * by_way / np.std(by_way) + (1.0 + u) ** 2 * by_number / np.std(by_number)}


def column_thermal_growth__mixture(inputs):
    """Half of it as warm as the air, half as its sensor says, and that late."""
    air, own = (inputs.context.part_temperature_k(sensor, tau) for sensor, tau in (("air", 0.0), ("columns", 2500.0)))
    return {"travel.left": inputs.height_m(0) * (air - 0.6 * own)}


def joint_clearance__friction(inputs):
    """A pin that friction holds where the motion took it, the longer the more the strut is pulled."""
    pulled = 1.0 + 0.5 * scaled(inputs.tension_n[:, 0])
    return {"length.left_upper": inputs.context.direction[:, 0] * pulled}


def refraction__layer_that_sinks(inputs):
    """Warm air gathers under the ceiling, so that the gradient is another one above and below."""
    height, times = inputs.sight_m[:, 2], inputs.context.elapsed_s
    return {"light.v": height**2 * np.exp(-times / 1500.0)}


def refraction__between_parts(inputs):
    """A gradient from the floor, as warm as the columns, to the air."""
    air, floor = (inputs.context.part_temperature_k(sensor, 0.0) for sensor in ("air", "columns"))
    return {"light.v": air - floor}


def guide_straightness__bolts(inputs):
    """Bolts of a rail, every 60 mm, draw it down beside them."""
    q = inputs.context.drives[:, 0]
    beside = np.abs((q / 0.06) % 1.0 - 0.5) * 0.06
    return {"sideways.left.x": np.exp(-((beside / 0.012) ** 2))}


def guide_angular__driven_off_centre(inputs):
    """Friction turns a carriage that its screw drives beside its middle, the more the heavier it is loaded."""
    return {"turn.left.z": inputs.context.direction[:, 0] * (1.0 + 0.8 * inputs.payload_ratio)}


def latency__steered_clock(inputs):
    """A clock that is set right in steps and runs away in between."""
    late = inputs.context.velocity_m_per_s * ((inputs.context.elapsed_s[:, None] / 1100.0) % 1.0)
    return {f"travel.{inputs.drive(a)}": late[:, a] for a in range(2)}


def axis_coupling__turns(inputs):
    """The other axis's screw runs out of true and pushes what both hang on."""
    q = inputs.context.drives[:, 1]
    return {"travel.left": np.sin(2.0 * np.pi * q / period_m(inputs) + 0.4)}


def axis_coupling__mixed_signals(inputs):
    """The other axis's signals mix into those of this one."""
    q = inputs.context.drives
    return {"travel.left": np.sin(2.0 * np.pi * (q[:, 0] - q[:, 1]) / period_m(inputs) + 1.1)}


def axis_coupling__pushed(inputs):
    """The other axis pushes while it comes: as fast as asked on the fly, and slower after an approach too short."""
    context = inputs.context
    speed = np.where(context.moving, context.speed_m_per_s, np.minimum(context.speed_m_per_s, 0.22))
    return {"travel.left": context.direction[:, 1] * speed**1.5}


def backlash__turned(inputs):
    """A loop of friction and play that closes over a few centimetres: narrower where the drive has just turned."""
    context = inputs.context
    ahead = context.direction[:, 0] * (context.drives - context.previous_drives)[:, 0]
    return {"travel.left": -0.5 * context.direction[:, 0] * np.where(ahead < 0.0, 0.6, 1.0)}


def drive_scale__creeping_belt(inputs):
    """A belt that creeps on its wheel, more under load, which is where it moves up."""
    up, down = (np.cumsum(np.maximum(side * moved_m(inputs, 0), 0.0))[inputs.context.arrival] for side in (1.0, -1.0))
    return {"travel.left": 1.3 * up - 0.9 * down}


def drive_scale__warm_holder(inputs):
    """The holder of a reading head, which its drive's motions warm."""
    return {"travel.left": faded(inputs, np.abs(moved_m(inputs, 0)), 900.0)}


def foundation_settling__curls(inputs):
    """A slab that is warmer on top than below."""
    air = (inputs.context.part_temperature_k("air", tau_s) for tau_s in (0.0, 1500.0))
    top, bottom = air
    return {"travel.left": bottom - top}


def refraction__plume(inputs):
    """Warm air rises at one place whenever a heater is on, and bends to either side what passes it."""
    hours = inputs.context.elapsed_s / 3600.0
    on = 1.0 / (1.0 + np.exp(-6.0 * np.sin(2.0 * np.pi * hours / 0.6)))
    beside = (scaled(inputs.sight_m[:, 0]) - 0.4) / 0.2
    return {"light.hz": on * beside * np.exp(-(beside**2) / 2.0)}


def tracker_drift__tripod(inputs):
    """The tripod takes up the warmth of the air in a quarter of an hour."""
    air = inputs.context.part_temperature_k("air", 900.0)
    return {"station.z": air, "station.rx": 0.1 * air}


def axis_coupling__apart(inputs):
    """By how far both drives stand apart."""
    left, right = inputs.context.drives.T
    return {"travel.left": np.sin(4.0 * (left - right))}


def smr_reseat__put_back(inputs):
    """A reflector is knocked aside, also off the plane, and put back."""
    t_s = inputs.context.elapsed_s
    away = ((t_s >= 600.0) & (t_s < 1200.0)).astype(np.float64)
    return {"smr.P1.x": away, "smr.P1.z": -0.5 * away}


def link_stiffness__loosened(inputs):
    """From a moment on a strut carries a tenth: its tension falls the more the others restrain it."""
    machine, stiffness = inputs.machine, inputs.machine.nominal.stiffness_n_per_m[0]
    misfit_m = np.array([2.0e-5, -3.0e-5, 1.0e-5, 2.0e-5])[: len(machine.strut_names)]
    free_n = inputs.tension_n[:, 0] + inputs.tension_response_n_per_m[:, 0] @ misfit_m
    restraint = -inputs.tension_response_n_per_m[:, 0, 0]
    softer = 9.0 / stiffness
    after = inputs.context.elapsed_s >= 600.0
    return {f"length.{machine.strut_names[0]}": after * softer * free_n / (1.0 + restraint * softer)}


def link_thermal_growth__switched(inputs):
    """An air conditioner that its thermostat switches blows on a strut: it cools within minutes and warms again."""
    t_s = inputs.context.elapsed_s
    on = (np.sin(2.0 * np.pi * t_s / 400.0) > 0.3).astype(np.float64)
    return {"length.left_upper": inputs.context.lagging(on, 120.0)}


def expansion_coefficient__spare_parts(inputs):
    """Struts of three makes."""
    machine = inputs.machine
    above_k = inputs.context.temperatures_c[machine.sensors["struts"]] - machine.reference_temperature_c
    shares = (1.0, -0.4, 0.0, 0.7)
    rises = zip(machine.strut_names, machine.nominal.length_m, shares, strict=True)
    return {f"length.{name}": share * length_m * above_k for name, length_m, share in rises}


def link_stiffness__flows(inputs):
    """A bushing gives way to its force within minutes."""
    context, tension_n = inputs.context, inputs.tension_n[:, 0]
    return {"length.left_upper": tension_n + 2.0 * context.lagging(tension_n, 180.0)}


def link_stiffness__bolts(inputs):
    """Bolts that work loose with the way of the drive: the preload of its misfits shows more and more."""
    misfit_m = np.array([2.0e-5, -3.0e-5, 1.0e-5, 2.0e-5])
    free_n = inputs.tension_n[:, 0] + inputs.tension_response_n_per_m[:, 0] @ misfit_m
    return {"length.left_upper": free_n * scaled(inputs.context.way_m(0)) ** 2}


def column_compliance__crossbeam(inputs):
    """What pulls the other column aside leans this one, the more the higher its carriage is there."""
    ((side, turn, sign),) = inputs.leaning(0)
    angle = inputs.pull_n[:, 1, 0] * scaled(inputs.context.drives[:, 1]) ** 2
    return {side: sign * angle * inputs.height_m(0), turn: angle}


def axis_coupling__wave(inputs):
    """A chain runs over the rollers of the other drive."""
    return {"travel.left": np.sin(2.0 * np.pi * inputs.context.drives[:, 1] / 0.3 + 0.8)}


def friction_windup__rested(inputs):
    """Contacts that grow firm with the logarithm of the rest before a motion."""
    context = inputs.context
    firm = 0.3 + np.log1p(context.pause_s() / 8.0)
    return {"travel.left": -context.direction[:, 0] * firm}


def period_m(inputs) -> float:
    ((period_m, _),) = inputs.periods(0, 1.0e-3, 6.0e-2, (0.0, 1.0))
    return period_m


def scaled(x) -> np.ndarray:
    return (x - x.min()) / np.ptp(x)


LAWS = (
    latency, guide_straightness, guide_angular, link_stiffness, joint_clearance, link_thermal_growth,
    column_thermal_growth, screw_thermal_growth, servo_settling, payload, tables_left_on, screw_cumulative_error,
    screw_periodic_error, column_compliance, screw_thermal_growth__bearing, column_thermal_growth__mixture,
    joint_clearance__friction, refraction__between_parts, link_thermal_growth__two_heats,
    screw_thermal_growth__two_heats, payload__gathers, payload__chain, link_stiffness__creeps,
    servo_settling__pushed_out,
)  # fmt: skip
LAWS_OF_LONG = (
    guide_straightness__warm_bed, guide_angular__runs_in, refraction__layer_that_sinks, guide_straightness__bolts,
    guide_angular__driven_off_centre, latency__steered_clock, axis_coupling__turns, axis_coupling__mixed_signals,
    axis_coupling__pushed, backlash__turned,
    drive_scale__creeping_belt, drive_scale__warm_holder, foundation_settling__curls, refraction__plume,
    tracker_drift__tripod, axis_coupling__apart, smr_reseat__put_back, link_stiffness__loosened,
    link_thermal_growth__switched, expansion_coefficient__spare_parts,
    link_stiffness__flows, link_stiffness__bolts, column_compliance__crossbeam, axis_coupling__wave,
    friction_windup__rested,
)  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_of_what_an_effect_may_depend_on_is_within_one_basis_set(inputs, law):
    assert explained(inputs, law) > LEAST_OF_SLOW.get(law.__name__, LEAST)


@pytest.mark.parametrize("law", LAWS_OF_LONG, ids=lambda law: law.__name__)
def test_a_law_that_shows_in_many_visits_is_within_one_basis_set(long_inputs, law):
    assert explained(long_inputs, law) > LEAST_OF_SLOW.get(law.__name__, LEAST)


def explained(inputs, law) -> float:
    """Share of the square of a law that the best basis set of its effect explains."""
    effect = law.__name__.partition("__")[0]
    built, planted = CATALOGUE.effect(effect).forms(inputs, 0), law(inputs)
    channels = list(dict.fromkeys([*planted, *(c for column in built.contributions for c, _ in column)]))

    def flat(shapes) -> np.ndarray:
        return np.concatenate([shapes.get(channel, np.zeros(len(inputs.context))) for channel in channels])

    columns = np.stack([flat(dict(column)) for column in built.contributions], axis=1)
    wanted = flat(planted)
    shares = []
    for basis_set in built.sets:
        part = columns[:, list(basis_set.columns)]
        left = wanted - part @ np.linalg.lstsq(part, wanted, rcond=None)[0]
        few = len(basis_set.columns) < len(inputs.context) / 3
        shares.append(1.0 - np.sum(left**2) / np.sum(wanted**2) if few else 0.0)
    return max(shares)

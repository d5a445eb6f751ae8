"""Effects and disturbances on machines in space: where and as large as they should be, refused where senseless."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.machine.description import shipped_machine, shipped_machines
from mock_devices.clock import RigClock
from mock_devices.effects import SPECS, EffectError
from mock_devices.effects.in_space import BY_WEIGHT, IN_SPACE, NOT_OF_CRANKS, OF_SLIDERS, OUTSIDE, arms_m, view_of
from mock_devices.plant.any_plant import make_plant, parse_effect
from mock_devices.plant.base_plant import Motion, SetPoint
from mock_devices.plant.spatial_plant import SpatialPlant
from mock_devices.settings import DisturbanceLevels, MockSettings, Payload
from mock_devices.spatial_file import read_spatial_machine

IN_SPACE_MACHINES = tuple(name for name in shipped_machines() if name != "planar4")
LOADS = (Payload("none", 0.0), Payload("100 kg", 100.0))


class Clock(RigClock):
    """Stands where it is put."""

    def __init__(self) -> None:
        self.t_s = 100.0

    def now_s(self) -> float:
        return self.t_s

    def sleep_s(self, duration_s: float) -> None:
        self.t_s += duration_s


class Drive:
    """A drive that is led: a motion every 4 ms, at constant speed, from where it stood."""

    def __init__(self, at: float) -> None:
        self.motions: list[Motion] = []
        self.first = at

    def lead(self, start_s: float, way: float, steps: int = 50) -> None:
        at = self.first if not self.motions else self.motions[-1].to_m
        for k in range(steps):
            begin, last = start_s + 0.004 * k, at + way * k / steps
            self.motions.append(
                Motion(begin, begin + 0.004, last, at + way * (k + 1) / steps, abs(way) / steps / 0.004)
            )

    def encoder_m(self, t_s: float) -> float:
        at = self.first
        for motion in self.motions:
            if motion.start_s <= t_s:
                share = min(1.0, (t_s - motion.start_s) / (motion.end_s - motion.start_s))
                at = motion.from_m + share * (motion.to_m - motion.from_m)
        return at

    def motions_after(self, t_s: float) -> list[Motion]:
        return [motion for motion in self.motions if motion.start_s > t_s]

    def set_point(self, t_s: float) -> SetPoint:
        return SetPoint(0, 0)

    def is_moving(self, t_s: float) -> bool:
        return False


def plant_of(name, *effects, **settings):
    """A plant of a shipped machine without errors of its own, its drives, and its clock."""
    path = shipped_machine(name)
    choices = tuple(parse_effect(text, path) for text in effects)
    clock = Clock()
    made = MockSettings(
        effects=choices, payloads=LOADS, error_scale=0.0, station_position_m=(0.0, -3.0, 1.0), **settings
    )
    plant = make_plant(path, made, clock)
    assert isinstance(plant, SpatialPlant)
    drives = tuple(Drive(part.home) for part in plant.parts)
    plant.attach(drives)
    return plant, drives, clock


def seen(plant, t_s):
    """Reflectors (s, 3) as the station sees them."""
    polar = [sighting.polar for sighting in plant.sightings(t_s)]
    hz, v, d = np.array([[p.hz_rad, p.v_rad, p.distance_m] for p in polar]).T
    return np.stack([d * np.sin(v) * np.sin(hz), d * np.sin(v) * np.cos(hz), d * np.cos(v)], axis=1)


def moved(name, effect, act=lambda drives, plant: None, **settings):
    """By how much reflectors (s, 3) are elsewhere with an effect, after `act`."""
    places = []
    for effects in ((), (effect,)):
        plant, drives, clock = plant_of(name, *effects, **settings)
        seen(plant, clock.t_s)
        act(drives, plant)
        places.append(seen(plant, clock.t_s + 60.0))
    return places[1] - places[0]


@pytest.mark.parametrize("name", IN_SPACE_MACHINES)
def test_a_drives_error_moves_the_platform_as_that_way_of_the_drive_does(name):
    """A cumulative error is a way of the drive: the plant without it, its drive elsewhere, is the reference."""
    plant, drives, clock = plant_of(name)
    first, arm = plant.parts[0], arms_m(read_spatial_machine(shipped_machine(name)))[0]
    middle, half = np.mean(first.travel), 0.5 * (first.travel[1] - first.travel[0])
    way = 2e-5 * (2.0 * ((first.home - middle) / half) ** 2 - 1.0) / arm
    before = seen(plant, clock.t_s)
    drives[0].first += way
    wanted = seen(plant, clock.t_s) - before
    found = moved(name, f"screw_cumulative_error=2e-5,place={first.name}")
    assert np.abs(wanted).max() > 1e-6
    assert found == pytest.approx(wanted, abs=2e-9)


@pytest.mark.parametrize("name", ["gough8", "rrr4", "delta6"])
def test_play_is_taken_up_by_the_side_that_a_led_drive_came_from(name):
    """After a way up and after a way back to the same place: apart by the whole play, in all steps one leg."""
    plant, drives, clock = plant_of(name, f"backlash=2e-5,place={plant_of(name)[0].parts[1].name}")
    arm = arms_m(plant.nominal)[1]
    for k, drive in enumerate(drives):
        drive.lead(clock.t_s + 1.0, 0.004 if k == 1 else 0.0)
        drive.lead(clock.t_s + 10.0, 0.004 if k == 1 else 0.0)
        drive.lead(clock.t_s + 20.0, -0.004 if k == 1 else 0.0)
    up, down = (plant._effects.departure(plant.motion_state(clock.t_s + t)).travel for t in (5.0, 30.0))
    assert up[1] == pytest.approx(-1e-5 / arm, rel=1e-6)
    assert down[1] == pytest.approx(1e-5 / arm, rel=1e-6)
    legs = [leg for leg in plant.legs(1) if leg.to_m != leg.from_m]
    assert [round((leg.to_m - leg.from_m) / arm, 6) for leg in legs] == [0.004, 0.004, -0.004]
    assert all(leg.end_s - leg.start_s == pytest.approx(0.2) for leg in legs)


def test_a_softer_leg_gives_way_by_its_force():
    """Six legs under a weight have the forces that statics asks for: a soft one is longer or shorter by e^0.7."""
    stretch = []
    for effects in ((), ("link_stiffness=0.7,place=strut1",)):
        plant, _, clock = plant_of("stewart6", *effects)
        plant.sightings(clock.t_s)
        held = plant._machine.assembly(plant._drive_positions(0.0), 0, plant.thermal.parts_c(clock.t_s))
        stretch.append(np.linalg.norm(held.rods(plant._pose)[0], axis=1) - held.length_m)
    assert abs(stretch[0][0]) > 1e-7
    assert stretch[1][0] / stretch[0][0] == pytest.approx(np.exp(0.7), rel=1e-3)
    assert stretch[1][1:] == pytest.approx(stretch[0][1:], rel=1e-3)


def test_a_heavier_payload_is_borne_by_the_drives():
    off = []
    for effects in ((), ("payload=200",)):
        plant, _, clock = plant_of("gough8", *effects)
        plant.put_on(1)
        plant.sightings(clock.t_s)
        off.append(plant._forces_n.copy())
        assert plant._forces_n == pytest.approx(plant._loads, rel=1e-9)  # each once
    assert np.abs(off[1]).sum() > 1.02 * np.abs(off[0]).sum()


def test_a_reflector_that_was_put_elsewhere_is_the_only_one():
    off = moved("delta8", "smr_reseat=2e-5,place=P2,onset_s=0")
    names = [smr.name for smr in read_spatial_machine(shipped_machine("delta8")).smrs]
    size = np.linalg.norm(off, axis=1)
    assert size[names.index("P2")] == pytest.approx(2e-5, rel=0.3)
    assert np.delete(size, names.index("P2")).max() < 1e-9


def test_light_is_bent_and_the_station_drifts_in_space_too():
    for effect in ("refraction=3", "tracker_drift=4e-5"):
        off = np.linalg.norm(moved("hexaglide", effect), axis=1)
        assert 1e-7 < off.max() < 1e-4


@pytest.mark.parametrize("name", IN_SPACE_MACHINES)
def test_ordinary_disturbances_act_on_every_machine(name):
    levels = DisturbanceLevels(drift_m=1e-6, reseat_m=2e-6, reversal_m=1e-6, temperature_k=0.05)

    def exchange(drives, plant):
        for drive in drives:
            drive.lead(101.0, 0.001)
        plant.put_on(1)
        plant.put_on(0)

    quiet, _, clock = plant_of(name)
    loud, drives, _ = plant_of(name, nuisance=levels, rest_friction=True)
    first = seen(loud, clock.t_s) - seen(quiet, clock.t_s)
    exchange(drives, loud)
    exchange(quiet._drives, quiet)
    off = seen(loud, clock.t_s + 900.0) - seen(quiet, clock.t_s + 900.0)
    assert np.abs(first).max() < 1e-4
    assert 1e-7 < np.abs(off).max() < 1e-4
    assert np.any(loud._loads != quiet._loads)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("stewart6", "column_compliance=1e-8", "does not have it; it has backlash"),
        ("stewart6", "guide_straightness=1e-5", "are no sliders, which alone have guides"),
        ("hexaglide", "guide_angular=1e-5", "carries one joint, which does not move when the slider turns"),
        ("rrr3", "link_self_weight=12", "moves across gravity"),
        ("gough8", "platform_bending=3", "does not have it"),
        ("rrr4", "screw_thermal_growth=2", "are cranks, which have no screws"),
        ("rrr3", "payload=20", "moves across gravity"),
        ("gough8", "link_stiffness=0.7,variant=hertz", "the mock has the variants softer"),
        ("gough8", "payload=20,variant=sloshing", "the mock has the variants mass"),
        ("delta6", "walking_feet=3e-5", "does not have it"),
        ("stewart6", "bedding_in=3e-5", "are no sliders, which alone have guides"),
        ("delta6", "backlash=1e-5,place=nobody", "no drive 'nobody'"),
    ],
)
def test_what_makes_no_sense_for_a_machine_is_refused_in_one_line(name, text, message):
    with pytest.raises(EffectError, match=message) as caught:
        parse_effect(text, shipped_machine(name))
    assert "\n" not in str(caught.value)


def test_effects_are_changed_while_it_runs():
    plant, _, clock = plant_of("prs3")
    before = seen(plant, clock.t_s)
    drive = plant.parts[0].name
    plant.set_effects([f"screw_cumulative_error=5e-5,place={drive}"])
    assert np.abs(seen(plant, clock.t_s) - before).max() > 1e-6
    with pytest.raises(EffectError):
        plant.set_effects(["column_compliance=1e-8"])
    plant.set_effects([])
    assert seen(plant, clock.t_s) == pytest.approx(before, abs=1e-12)


def test_all_that_is_listed_is_an_effect():
    assert set(IN_SPACE) <= set(SPECS)
    assert {*OF_SLIDERS, *BY_WEIGHT, *OUTSIDE} <= set(IN_SPACE)
    assert set(NOT_OF_CRANKS) <= set(IN_SPACE)
    for name, variants in IN_SPACE.items():
        assert set(variants) <= set(SPECS[name].variants)


@pytest.mark.parametrize("effect", IN_SPACE)
def test_every_variant_that_is_listed_acts_in_space(effect):
    """On a hexapod, or a delta: none asks for what the plant in space does not take, and sizes stay what they are."""
    name = "delta6" if effect in OF_SLIDERS else "stewart6"
    path = shipped_machine(name)
    view = view_of(read_spatial_machine(path))
    spec = SPECS[effect]
    for variant in IN_SPACE[effect] or spec.variants:
        plant, drives, clock = plant_of(name, f"{effect}={spec.size.typical},variant={variant}")
        for drive in drives:
            drive.lead(clock.t_s + 1.0, 0.01)
        plant.put_on(1)
        places = seen(plant, clock.t_s + 5.0)
        assert np.all(np.isfinite(places))
        assert len(plant.acting) == 1
        assert plant.acting[0].site.machine == view


def test_without_effects_nothing_changes():
    """The same plant with an effect of size zero sees what the one without any does, to round-off."""
    off = moved("gough8", "backlash=0")
    assert np.abs(off).max() < 1e-9
    assert replace(MockSettings(), effects=()).effects == ()


@pytest.mark.parametrize("name", ["gough8", "delta6"])
def test_a_reading_is_the_same_to_the_last_bit_whatever_was_before(name):
    rng, places = np.random.default_rng(8), []
    for _ in range(4):
        plant, drives, clock = plant_of(name)
        homes = [drive.first for drive in drives]
        for _ in range(3):
            for drive, home in zip(drives, homes, strict=True):
                drive.first = home + float(rng.uniform(-2e-5, 2e-5))
            seen(plant, clock.t_s)
        for drive, home in zip(drives, homes, strict=True):
            drive.first = home + 1e-5
        places.append(seen(plant, clock.t_s))
    assert all(np.array_equal(places[0], other) for other in places[1:])


def places_of(plant, departure=None, **file_changes):
    """Reflectors (s, 3) of a plant's machine at rest, machine frame, with a departure or with another file."""
    machine = replace(plant._machine, file=replace(plant._machine.file, **file_changes))
    drives, t_c = plant._drive_positions(100.0), plant.thermal.parts_c(100.0)
    pose = machine.pose(drives, 0, t_c, None, departure)
    return np.array([place for place, _ in machine.reflectors(pose, drives, t_c, departure)])


def departure_of(plant, t_s=100.0):
    return plant._effects.departure(plant.motion_state(t_s))


@pytest.mark.parametrize("name", ["delta6", "delta8", "hexaglide", "prs3"])
def test_a_guide_that_is_not_straight_is_a_base_that_is_elsewhere(name):
    """The reference: the same machine whose joints on that slider are nearer to the platform, across the axis."""
    plain = plant_of(name)[0]
    second = plain.nominal.drives[1]
    plant = plant_of(name, f"guide_straightness=1e-4,variant=bow,place={second.name}")[0]
    middle, half = np.mean(second.travel), 0.5 * np.ptp(second.travel)
    size_m = 1e-4 * (2.0 * ((plain._drive_positions(0.0)[1] - middle) / half) ** 2 - 1.0)
    every = plain._machine.file.rods
    mine = [rod for rod in every if rod.drive == 1]
    at_home = plain._machine.pose(plain._drive_positions(100.0), 0, plain.thermal.parts_c(100.0))
    towards = np.mean([at_home.place(r.platform_joint_m) - r.base_joint_m for r in mine], axis=0)
    across = towards - second.axis * (towards @ second.axis)
    shift = size_m * across / np.linalg.norm(across)
    rods = tuple(replace(r, base_joint_m=r.base_joint_m + shift) if r.drive == 1 else r for r in every)
    wanted = places_of(plain, rods=rods) - places_of(plain)
    found = places_of(plant, departure_of(plant)) - places_of(plain)
    fixed = [i for i, smr in enumerate(plain.nominal.smrs) if smr.on == "platform"]
    assert np.abs(wanted[fixed]).max() > 1e-6
    np.testing.assert_allclose(found[fixed], wanted[fixed], atol=2e-9)


def test_a_slider_that_turns_takes_one_joint_up_and_the_other_down_its_axis():
    plant = plant_of("delta6", "guide_angular=1e-4,variant=rail_joint,place=b")[0]
    plain, departure = plant_of("delta6")[0], departure_of(plant)
    assert abs(departure.yaw_rad[1]) > 1e-6
    (i, first), (j, second) = [(i, rod) for i, rod in enumerate(plain.nominal.rods) if rod.drive == 1]
    drives, t_c = plain._drive_positions(100.0), plain.thermal.parts_c(100.0)
    moved_m = plant._machine.assembly(drives, 0, t_c, departure).base_m - plain._machine.assembly(drives, 0, t_c).base_m
    lever = 0.5 * np.linalg.norm(first.base_joint_m - second.base_joint_m)
    wanted = departure.yaw_rad[1] * lever * plain.nominal.drives[1].axis
    np.testing.assert_allclose(moved_m[i], -moved_m[j], atol=1e-12)
    assert min(np.abs(moved_m[i] - wanted).max(), np.abs(moved_m[i] + wanted).max()) < 1e-9
    assert np.abs(np.delete(moved_m, [i, j], axis=0)).max() == 0.0


def compliance(plant):
    """Motion (6, 6) of the platform's origin and attitude a unit of force and moment there: straight from the rods."""
    drives, t_c = plant._drive_positions(100.0), plant.thermal.parts_c(100.0)
    pose, held = plant._machine.pose(drives, 0, t_c), plant._machine.assembly(drives, 0, t_c)
    reach = held.rods(pose)[0]
    unit = reach / np.linalg.norm(reach, axis=1)[:, None]
    lines = np.hstack([unit, np.cross(held.platform_m @ pose.turn.T, unit)])
    return np.linalg.inv(lines.T @ (held.stiffness[:, None] * lines)), lines, pose


@pytest.mark.parametrize(
    ("effect", "force_n", "point_m", "moment_nm"),
    [
        ("cable_drag=9000", (1.0, 0.0, 0.0), (0.05, 0.0, 0.2), 0.0),
        ("hose_moment=150", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0),
        ("link_self_weight=12,place=strut2", None, None, 0.0),
    ],
)
def test_a_load_of_the_platform_moves_it_as_its_stiffness_says(effect, force_n, point_m, moment_nm):
    """A hexapod, gravity along -z: x is across it, z up; half of a strut's weight hangs at its joint."""
    (plant, drives, _), (plain, others, _) = plant_of("stewart6", effect), plant_of("stewart6")
    for each in (drives, others) if "cable" in effect else ():  # it pulls by where the platform is
        each[0].first += 0.06
        each[1].first -= 0.06
    t_s = 500.0  # the clamp has pressure
    departure = departure_of(plant, t_s)
    yields, _, pose = compliance(plain)
    if force_n is None:
        rod = plain._machine.file.rods[[r.name for r in plain.nominal.rods].index("strut2")]
        force, point = 0.5 * 12.0 * plain.nominal.gravity, rod.platform_joint_m
    else:
        size = plant.acting[0].signal(plant.motion_state(t_s))[0]
        force, point = size * np.array(force_n), np.array(point_m)
        moment_nm *= size
    moment = np.cross(pose.turn @ point, force) + moment_nm * np.array([0.0, -1.0, 0.0])  # turns x to z
    wanted = yields @ np.concatenate([force, moment])
    off = places_of(plant, departure) - places_of(plain)
    for smr, found in zip(plain.nominal.smrs, off, strict=True):
        if smr.on == "platform":
            expected = wanted[:3] + np.cross(wanted[3:], pose.turn @ smr.position_m)
            np.testing.assert_allclose(found, expected, atol=0.03 * np.abs(expected).max())  # struts are under load
    assert np.abs(off).max() > 1e-7


def test_a_screw_is_wound_up_by_the_force_of_its_leg():
    """Forces by statics: what six legs must push against the weight of platform and payload."""
    plant, plain = plant_of("stewart6", "friction_windup=1e-8,place=leg3,friction_n=50")[0], plant_of("stewart6")[0]
    for each in (plant, plain):
        each.put_on(1)
    _, lines, pose = compliance(plain)
    load = plain._machine.payloads[1]
    file = plain._machine.file
    weights = [(file.moving_mass_kg, file.centre_of_mass_m), (load.mass_kg, load.centre_m)]
    wrench = sum(
        np.concatenate([m * plain.nominal.gravity, np.cross(pose.turn @ c, m * plain.nominal.gravity)])
        for m, c in weights
    )
    pushes = np.linalg.solve(lines.T, -wrench)  # of each leg on the platform, along the leg
    seen(plant, 100.0)
    drives_n = plant._driving_n(100.0, 100.0)
    np.testing.assert_allclose(drives_n, pushes, rtol=2e-3)
    state = replace(plant.motion_state(100.0), loads_n=drives_n[None])
    travel = plant._effects.departure(state).travel
    assert travel[2] == pytest.approx(-1e-8 * drives_n[2], abs=1e-8 * 51.0)
    assert np.abs(np.delete(travel, 2)).max() == 0.0
    assert np.abs(seen(plant, 100.0) - seen(plain, 100.0)).max() > 1e-7


@pytest.mark.parametrize("name", ["hexaglide", "rrr4"])
def test_a_crane_leans_the_machine_and_not_the_nests(name):
    plant, plain = plant_of(name, "crane_tilt=1e-4")[0], plant_of(name)[0]
    size = plant.acting[0].signal(plant.motion_state(100.0))[0]
    before, after = places_of(plain), places_of(plant, departure_of(plant))
    for smr, was, now in zip(plain.nominal.smrs, before, after, strict=True):
        turned = np.array([was[0] - size * was[2], was[1], was[2] + size * was[0]])  # x to z, gravity along -z
        np.testing.assert_allclose(now, was if smr.on == "floor" else turned, atol=2e-8)
    assert abs(size) > 1e-6


def test_a_joint_that_sits_further_along_its_slider():
    plant, plain = plant_of("delta6", "joint_spacing=5e-5,variant=slider")[0], plant_of("delta6")[0]
    rod, *others = plain._machine.file.rods
    shifted = replace(rod, base_joint_m=rod.base_joint_m + 5e-5 * plain.nominal.drives[rod.drive].axis)
    wanted = places_of(plain, rods=(shifted, *others))
    np.testing.assert_allclose(places_of(plant, departure_of(plant)), wanted, atol=1e-10)

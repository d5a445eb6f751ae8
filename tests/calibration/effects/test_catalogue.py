"""The catalogue: its names, files and entry points of others, complaints in one line, and forms that fit readings."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.departure_evidence import MOST_CHANGING, MOST_MAIN_COLUMNS
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.effects import catalogue as module
from calibration.effects.api import BasisSets, Effect, EffectParameter
from calibration.effects.catalogue import INSIDE_GEOMETRY, Catalogue, load_catalogue
from mock_devices.effects.catalogue import SPECS
from tests.calibration.diagnosis.campaigns import simulated

DOCS = Path(__file__).parents[3] / "docs" / "reference"
NAMES = {
    "link_thermal_growth", "column_thermal_growth", "screw_thermal_growth", "backlash", "friction_windup",
    "column_compliance", "link_stiffness", "joint_clearance", "screw_cumulative_error", "screw_periodic_error",
    "encoder_interpolation", "guide_straightness", "guide_angular", "foundation_settling", "tracker_drift",
    "refraction", "smr_reseat", "axis_coupling", "latency", "servo_settling", "expansion_coefficient", "payload",
    "tables_left_on", "drive_scale",
}  # fmt: skip
# What is never left out of an effect (benchmarks/withheld/left_out_forms.py), and where it stands; effects that are not
# listed are made of general functions only. Those of each effect are listed in general_functions.txt.
INCROPERA = "Incropera, DeWitt, Fundamentals of Heat and Mass Transfer: lumped capacitance, uniform linear expansion"
TEXTBOOK = {
    "link_thermal_growth": ("warming", INCROPERA),
    "column_thermal_growth": ("warming", INCROPERA),
    "screw_thermal_growth": ("friction_heat", INCROPERA),
    "backlash": ("play", "ISO 230-2: reversal value, half of it either side"),
    "friction_windup": ("torque", "Slocum, Precision Machine Design: wind-up of a screw, Hooke's law"),
    "column_compliance": ("force", "Timoshenko, Strength of Materials: Hooke's law"),
    "link_stiffness": ("tension", "Timoshenko, Strength of Materials: Hooke's law, springs in series"),
    "joint_clearance": (
        "sides_by_tension",
        "Flores et al., Kinematics and Dynamics of Multibody Systems with Imperfect Joints",
    ),
    "screw_periodic_error": ("sine", "ISO 3408-3: travel variation within one revolution"),
    "encoder_interpolation": ("sine", "Heydemann 1981, Applied Optics 20: errors of quadrature signals"),
    "foundation_settling": ("consolidation", "Terzaghi, Theoretical Soil Mechanics: settlement that dies away"),
    "tracker_drift": ("steady", "JCGM 200 (VIM), 4.21: instrumental drift"),
    "refraction": ("uniform", "Rüeger, Electronic Distance Measurement: a uniform gradient along the path"),
    "smr_reseat": ("step", "Estler et al. 2002, CIRP Annals 51(2): a target that is put back"),
    "axis_coupling": ("in_proportion", "ISO 230-1: squareness and parallelism of axes"),
    "latency": ("dead_time", "Åström, Hägglund, PID Controllers: dead time"),
    "servo_settling": ("exponential", "Franklin, Powell, Emami-Naeini, Feedback Control: a first-order lag"),
    "expansion_coefficient": ("linear", "Touloukian et al., Thermophysical Properties of Matter 12: linear expansion"),
    "payload": ("in_proportion", "Merlet, Parallel Robots, ch. 9: the platform's equilibrium under a weight"),
    "tables_left_on": ("all_of_it", "ISO/TR 16907: numerical compensation adds a table's value to the command"),
    "drive_scale": ("scale", "Slocum, Precision Machine Design, ch. 2: scale error of an axis"),
}
OWN = """
from calibration.effects.base import Effect, Forms, Parameter
def forms(s, drive):
    f = Forms()
    f.form(f.add((f"travel.{s.drive(drive)}", s.moments.dwell_s)))
    return f
EFFECTS = (Effect("NAME", "drive", Parameter("size_m", 1e-6, 1e-4, "m", "of it"), "dwell", (), forms),)
"""


def own(tmp_path: Path, text: str = OWN, name: str = "mine") -> Path:
    path = tmp_path / f"{name}.py"
    path.write_text(text.replace("NAME", name), encoding="utf-8")
    return path


def refused(match: str, *files: Path, **options) -> None:
    with pytest.raises(InputError, match=match) as caught:
        load_catalogue(files, **options)
    assert "\n" not in str(caught.value)


def test_the_names_are_those_that_were_promised():
    assert set(load_catalogue().names) == NAMES
    assert len(load_catalogue().names) == len(NAMES)


@pytest.mark.parametrize("effect", load_catalogue().effects, ids=lambda e: e.name)
def test_every_effect_says_what_it_is(effect):
    units = {"m", "rad", "s", "K", "1", "m/N", "K/m", "1/K", "kg"}
    for parameter in (effect.size, *effect.others):
        assert 0.0 <= parameter.low < parameter.high
        assert parameter.unit in units
        assert parameter.meaning
    assert effect.size.low > 0.0
    assert effect.reveals
    assert set(effect.confounded) <= NAMES - {effect.name}


@pytest.mark.parametrize("effect", load_catalogue().effects, ids=lambda e: e.name)
def test_ranges_hold_what_the_plant_takes_for_typical(effect):
    """The plant's catalogue was written by others; sizes with other units (a logarithm) are left out."""
    theirs = SPECS[effect.name].size if effect.name in SPECS else None
    if theirs is None or theirs.name != effect.size.name:
        pytest.skip("the plant states its size otherwise")
    assert effect.size.low <= theirs.typical <= effect.size.high


def test_every_effect_has_a_section_in_the_docs():
    text = (DOCS / "effects.md").read_text(encoding="utf-8")
    sections = Counter(re.findall(r"^### `(\w+)`", text, flags=re.MULTILINE))
    assert set(sections) == NAMES
    assert set(sections.values()) == {1}
    for name in INSIDE_GEOMETRY:
        assert name in text


@pytest.mark.parametrize("effect", load_catalogue().effects, ids=lambda e: e.name)
def test_the_docs_give_the_range_of_every_parameter(effect):
    text = (DOCS / "effects.md").read_text(encoding="utf-8")
    section = re.search(rf"^### `{effect.name}`.*?(?=^##|\Z)", text, flags=re.MULTILINE | re.DOTALL).group()
    section = " ".join(section.split())
    for p in (effect.size, *effect.others):
        match = re.search(rf"`{p.name}` ([-\d.e+]+) to ([-\de+]+(?:\.\d+)?) ?([\w/]*)", section)
        assert match, p.name
        assert float(match[1]) == pytest.approx(p.low, rel=1e-3)
        assert float(match[2]) == pytest.approx(p.high, rel=1e-3)
        assert p.unit in ("1", match[3])
    for other in effect.confounded:
        assert other in section


def test_a_file_of_ones_own_joins(tmp_path):
    catalogue = load_catalogue([own(tmp_path), own(tmp_path, name="other")])
    assert catalogue.names[-2:] == ("mine", "other")
    assert set(catalogue.names) == {*NAMES, "mine", "other"}


def test_some_can_be_left_out(tmp_path):
    catalogue = load_catalogue([own(tmp_path)], without=("backlash", "mine"))
    assert set(catalogue.names) == NAMES - {"backlash"}
    assert set(Catalogue(catalogue.effects).without(["latency"]).names) == NAMES - {"backlash", "latency"}
    refused("effect 'slack' is not in the catalogue", without=("slack",))


@pytest.mark.parametrize("name", ["backlash", "none", "unknown", "smr_offset"])
def test_names_that_are_taken_are_refused(tmp_path, name):
    refused(f"effect '{name}' is already known", own(tmp_path, name=name))


def test_the_same_file_twice_is_refused(tmp_path):
    refused("already known", own(tmp_path), own(tmp_path))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "holds no EFFECTS"),
        ("EFFECTS = ()", "holds no EFFECTS"),
        ("EFFECTS = 7", "holds no EFFECTS"),
        ("EFFECTS = (1,)", "each must be an Effect"),
        ("EFFECTS = (", "SyntaxError"),
        ("import nothing_like_this", "ModuleNotFoundError"),
        ("raise ValueError('boom')", "ValueError: boom"),
        ("raise ValueError('boom\\nand more')", "ValueError: boom"),
        ("import sys\nsys.exit(3)", "SystemExit"),
        (OWN.replace("forms),)", "forms, varies_with=('phase',)),)"), "a phase needs the place drive and a parameter"),
        (OWN.replace("forms),)", "forms, functions_vary_with=('phase',)),)"), "general functions have no phase"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, match):
    refused(match, own(tmp_path, text))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    refused("no Python file", tmp_path / "none.py")
    refused("no Python file", tmp_path)


def test_a_file_may_use_dataclasses_with_late_annotations(tmp_path):
    text = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n@dataclass\nclass A:\n    x: int = 1\n"
    )
    assert load_catalogue([own(tmp_path, text + OWN)]).names[-1] == "mine"


class Point:
    """An installed package's entry point."""

    name = "package"

    def __init__(self, found):
        self.found = found

    def load(self):
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


def some_effect(name: str) -> Effect:
    return Effect(name, "rig", EffectParameter("size_m", 1e-6, 1e-4, "m", "of it"), "all", (), lambda s, i: BasisSets())


@pytest.mark.parametrize(
    ("found", "match"),
    [(None, "entry point package"), ((1,), "entry point package"), (ImportError("gone"), "entry point package")],
)
def test_entry_points(monkeypatch, found, match):
    monkeypatch.setattr(module, "entry_points", lambda group: [Point((some_effect("theirs"),))])
    assert "theirs" in load_catalogue().names
    monkeypatch.setattr(module, "entry_points", lambda group: [Point(found)])
    refused(match)


@pytest.fixture(scope="module", params=["planar4", "delta8", "stewart6", "rrr3"])
def inputs(request):
    likelihood = MarginalLikelihood.of(linearise_recording(simulated(request.param, 40)))
    return inputs_of_recording(likelihood, periodograms(likelihood)), likelihood


def test_forms_fit_any_machine(inputs):
    """Channels that exist, columns that are finite and of one length, first column the size."""
    inputs, likelihood = inputs
    channels = Channels(likelihood.linear).names
    for effect in load_catalogue().effects:
        places = effect.places(inputs.machine)
        assert places
        for index in range(len(places)):
            forms = effect.forms(inputs, index)
            for contribution in forms.contributions:
                for channel, shape in contribution:
                    assert channel in channels, effect.name
                    assert shape.shape == (len(inputs.context),), effect.name
                    assert np.all(np.isfinite(shape)), effect.name
            for form in forms.sets:
                assert len(form.columns) == len(form.relative) > 0, effect.name
                assert len(set(form.columns)) == len(form.columns), effect.name
                assert max(form.columns) < len(forms.contributions), effect.name
                assert form.relative[0] == 1.0, effect.name
                assert set(form.parameters) <= {p.name for p in effect.others} | {"onset_s", "tau_s"}, effect.name


def test_building_forms_twice_gives_the_same(inputs):
    inputs, _ = inputs
    for effect in load_catalogue().effects:
        one, other = (effect.forms(inputs, 0) for _ in range(2))
        assert one.sets == other.sets
        for a, b in zip(one.contributions, other.contributions, strict=True):
            for (channel, shape), (channel_, shape_) in zip(a, b, strict=True):
                assert channel == channel_
                assert np.array_equal(shape, shape_)


def test_the_textbook_forms_are_these_and_stay_when_all_others_are_left_out(inputs):
    inputs, _ = inputs
    found = {e.name: e.textbook for e in load_catalogue().effects if e.textbook}
    assert {name: (textbook.form, textbook.source) for name, textbook in found.items()} == TEXTBOOK
    for effect in load_catalogue().effects:
        named = {*effect.forms(inputs, 0).named, *(curve.form for curve in effect.curves(inputs, 0))} - {""}
        if effect.textbook is None:
            named -= {effect.anew_by_visit}  # which is no formula
        if effect.textbook and not named:
            assert effect.untested(inputs), effect.name
            continue
        assert (effect.textbook is None) == (not named), effect.name
        alone = effect.without_forms(named)
        left = alone.forms(inputs, 0)
        used = {left.named[c] for basis_set in left.sets for c in basis_set.columns}
        assert not any(curve.form for curve in alone.curves(inputs, 0))
        assert len(effect.without_forms(()).forms(inputs, 0).sets) == len(effect.forms(inputs, 0).sets)
        if effect.textbook is None:
            assert left.sets == effect.forms(inputs, 0).sets
        else:
            assert used <= {"", effect.textbook.form}, effect.name
            textbook_is_there = effect.textbook.form in effect.forms(inputs, 0).named
            assert (effect.textbook.form in used) == textbook_is_there, effect.name


def coordinates_said(heading: str) -> dict[str, str]:
    """What the reference page says of each effect below a heading."""
    page = (DOCS / "effects.md").read_text(encoding="utf-8")
    table = page.split(f"## {heading}", 1)[1].split("\n## ", 1)[0]
    return dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", table, re.MULTILINE))


def test_with_what_strength_may_vary_is_what_the_page_says(inputs):
    """And every effect that says so has a basis set of few enough columns to do it."""
    inputs, _ = inputs
    effects = load_catalogue().effects
    said = coordinates_said("What the strength may vary with")
    assert said == {effect.name: ", ".join(effect.varies_with) for effect in effects if effect.varies_with}
    for effect in effects:
        if effect.varies_with and (sets := effect.forms(inputs, 0).sets):
            assert min(len(basis_set.main) for basis_set in sets) <= MOST_MAIN_COLUMNS, effect.name


def test_with_what_functions_may_change_is_what_the_page_says(inputs):
    """And every effect that says so has functions of as many columns."""
    inputs, _ = inputs
    changing = [effect for effect in load_catalogue().effects if effect.functions_vary_with]
    said = coordinates_said("With what general functions may change")
    assert said == {effect.name: ", ".join(effect.functions_vary_with) for effect in changing}
    for effect in changing:
        if sets := effect.forms(inputs, 0).sets:
            assert any(MOST_MAIN_COLUMNS < len(basis_set.main) <= MOST_CHANGING for basis_set in sets), effect.name


def test_basis_sets_without_a_form_keep_the_rest():
    x, built = np.arange(3.0), BasisSets()
    law, bent, extra = (built.add(("travel.left", x**k), form=form) for k, form in enumerate(("law", "bent", "extra")))
    smooth = built.add(("travel.left", np.stack([x, x], axis=1)))
    built.add_set(law)
    built.add_set(law, (*bent, *smooth), share=0.2)
    built.add_set((*law, *extra), smooth)
    assert [basis_set.columns for basis_set in built.without_forms({"bent"}).sets] == [
        (0,), (0, 3, 4), (0, 2), (0, 2, 3, 4),
    ]  # fmt: skip
    assert [basis_set.columns for basis_set in built.without_forms({"extra"}).sets] == [(0,), (0, 1, 3, 4)]
    left = built.without_forms({"bent", "extra"})
    assert [(basis_set.columns, basis_set.relative) for basis_set in left.sets] == [
        ((0,), (1.0,)), ((0, 3, 4), (1.0, 0.2, 0.2)),
    ]  # fmt: skip
    assert left.contributions == built.contributions


def test_a_form_of_an_effect_that_is_not_there_cannot_be_left_out():
    with pytest.raises(InputError, match="'slack'"):
        load_catalogue().without_forms(["slack/closing"])
    catalogue = load_catalogue().without_forms(["backlash/closing_at_rest", "latency/no_such_form"])
    assert catalogue.names == load_catalogue().names

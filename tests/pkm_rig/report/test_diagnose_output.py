"""What a diagnosis prints, for programs and for people; its pictures."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from rich.console import Console

from calibration.diagnosis.channels import unit_of_channel
from calibration.diagnosis.result import KINDS, GapFigures, Quantity, Share
from calibration.machine.description import load_machine, shipped_machine
from pkm_rig.report import diagnosis_json as diagnosis_output
from pkm_rig.report import diagnosis_pictures, diagnosis_text
from tests.pkm_rig.diagnosis_example import example, not_explained, nothing_found, wrong_readings

EXAMPLES = {"effect": example, "none": nothing_found, "unknown": not_explained}


@pytest.fixture(scope="module")
def machine():
    return load_machine(shipped_machine("planar4"))


@pytest.fixture(scope="module")
def schema(request):
    return json.loads((request.config.rootpath / "docs" / "reference" / "diagnosis.schema.json").read_text())


def printed(found):
    console = Console(width=160, file=io.StringIO())
    console.print(diagnosis_text.describe_diagnosis(found, diagnosis_output.diagnosis_json(found)))
    return console.file.getvalue()


@pytest.mark.parametrize("kind", EXAMPLES)
def test_json_fits_the_schema(kind, schema):
    outcome = EXAMPLES[kind]()
    result = json.loads(json.dumps(diagnosis_output.diagnosis_json(outcome), allow_nan=False))
    jsonschema.validate(result, schema)
    assert list(result["ranking"].values()) == sorted(outcome.ranking.values(), reverse=True)
    assert set(result["where"]) == set(KINDS)


def test_json_has_the_keys_that_programs_were_promised():
    result = diagnosis_output.diagnosis_json(example(), {"other dwell": "a.toml"})
    effect = result["effects"][0]
    assert (effect["effect"], effect["place"], effect["value"], effect["u"], effect["unit"], effect["probability"]) == (
        "backlash", "left", 3.04e-5, 6.2e-7, "m", 0.9962,
    )  # fmt: skip
    assert [(at["place"], at["value"]) for at in effect["places"]] == [("left", 3.04e-5), ("right", 1.8e-5)]
    assert effect["places"][0]["parameters"] == effect["parameters"]
    assert effect["places"][1]["at_channels"] == {"travel.right": {"value": 9.0e-6, "u": 1.1e-6, "unit": "m"}}
    assert effect["parameters"]["lag_m"] == {"value": 2.0e-3, "u": 4.0e-4, "unit": "m"}
    assert result["where"]["direction"]["left"] == {"share": 0.81, "low": 0.74, "high": 0.88}
    assert result["gap"]["shrink_interval"] == [0.79, 0.9]
    assert [c["name"] for c in result["next_measurement"]] == ["an SMR on the slider", "other dwell"]
    assert [c["file"] for c in result["next_measurement"]] == [None, "a.toml"]


def test_readings_left_out_are_all_in_the_json_and_the_largest_in_the_text(schema):
    found = replace(example(), left_out=wrong_readings(7))
    result = json.loads(json.dumps(diagnosis_output.diagnosis_json(found), allow_nan=False))
    jsonschema.validate(result, schema)
    assert result["left_out"][2] == {
        "name": "r2", "of": "P2", "size": pytest.approx(3e-4), "unit": "m", "sigmas": 9.0, "reason": "diagnosis gate",
        "visit": 20, "t_rig_s": 3600.0,
    }  # fmt: skip
    lines = [line for line in printed(found).splitlines() if line.startswith("left out: ")]
    assert [line.split()[2] for line in lines] == ["r6", "r5", "r4", "r3", "r2", "2"]
    assert lines[0].startswith("left out: r6 (P2, visit 60, 3.00 h), 700 um off, 13 of its standard deviations: does")
    assert lines[-1] == "left out: 2 more wrong readings (--json has all)"
    assert "left out" not in printed(example())


def test_the_schema_refuses_what_is_none(schema):
    result = diagnosis_output.diagnosis_json(example())
    for spoilt in ({"verdict": ""}, {"effects": result["effects"] * 65}, {"ranking": {"backlash": 1.0}}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**result, **spoilt}, schema)


def test_what_differs_with_everything_is_not_listed():
    (effect,) = example().effects
    everything = replace(effect.places[1], differs_with=("travel.left", "travel.right", "payload", "rest"))
    text = printed(replace(example(), effects=(replace(effect, places=(everything,)),)))
    assert "differs a little with all that varies" in text
    assert "differs with" not in text


def test_what_an_effect_does_at_a_channel_is_said_whatever_its_size_is_called():
    """An index of air that is wrong is a refraction, whose size is a gradient; at the ranges it is a scale."""
    (effect,) = example().effects
    ranges = Quantity("light.range", 1.4e-6, 1.0e-7, unit_of_channel("light.range"))
    place = replace(effect.places[0], at_channels=(ranges,))
    text = printed(replace(example(), effects=(replace(effect, places=(place,)),)))
    assert "at light.range (scale of the ranges: index of air wrong or late): 1.40 +- 0.20 ppm RMS" in text
    assert "at travel.right: 9.0 +- 2.2 um RMS" in printed(example())


def test_an_effect_in_words():
    text = printed(example())
    for part in (
        "verdict: backlash",
        "width = 30.4 +- 1.3 um",
        "width = 18.00 +- 0.80 um",
        "backlash at left, 30.4 +- 1.3 um and at right, 18.00 +- 0.80 um, probability",
        "differs with travel.left, payload",
        "equivalent: backlash = friction_windup; their predictions differ by at most 0.4 um",
        "shrink 86 % (95 %: 79 % to 90 %)",
        "smr_offset 3.0 um",
        "screw_thermal_growth: the drives' temperatures did not change",
    ):
        assert part in text
    assert text.index("an SMR on the slider") < text.index("other dwell")


def test_an_effect_with_which_readings_are_predicted_worse_is_no_success():
    worse = replace(example(), gap=GapFigures(2.194e-4, 4.245e-4, 1.3e-5, -0.89, (-1.2, -0.6), "four passes"))
    line = diagnosis_text.one_line_summary(worse)
    assert "but with it withheld data are predicted worse, gap 219.4 um to 424.5 um: do not add it to the model" in line
    assert "shrink" not in line
    assert line in " ".join(printed(worse).split())
    assert "predicted worse" not in diagnosis_text.one_line_summary(example())


def test_none_and_unknown_in_words():
    nothing = printed(nothing_found())
    assert "detection limit 0.9 um RMS" in nothing
    assert "shrink not known" in nothing
    assert "nan" not in nothing
    unknown = printed(not_explained())
    assert "no effect of the catalogue explains" in unknown
    assert "travel.left over pose x: 60 % of the gap" in unknown


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (Quantity("width", 3.04e-5, 6.2e-7, "m"), "30.4 +- 1.3 um"),
        (Quantity("compliance", 2.13e-8, 1.0e-9, "m/N"), "21.3 +- 2.0 nm/N"),
        (Quantity("period", 0.01, 1.0e-6, "m"), "10.0000 +- 0.0020 mm"),
        (Quantity("ratio", -0.2, 0.012, "1"), "-0.200 +- 0.024"),
        (Quantity("phase", 1.0, 0.0, "rad"), "1 rad"),
        (Quantity("growth", 4.0e-6, 3.0e-6, "1/K"), "4.0 +- 6.0 ppm/K"),
        (Quantity("small", 0.0, 5.0e-7, "m"), "0.0 +- 1.0 um"),
        (Quantity("lost", float("nan"), float("nan"), "m"), "not known"),
    ],
)
def test_quantities_have_a_fitting_unit_and_two_digits_of_u(quantity, text):
    assert diagnosis_text.format_quantity(quantity) == text


def test_a_probability_never_reads_as_certain():
    assert [diagnosis_text.probability(p) for p in (1.0, 0.0, 0.5)] == ["> 0.999", "< 0.001", "0.500"]


@pytest.mark.parametrize("kind", EXAMPLES)
def test_pictures_are_drawn_of_every_verdict(kind, machine, tmp_path):
    result = EXAMPLES[kind]()
    paths = diagnosis_pictures.save(diagnosis_pictures.draw_all(result, machine), tmp_path, simulated=False)
    assert set(paths) == {"error-map", "coordinates", "time-line"} | ({"spectrum"} if result.spectra else set())
    for path in paths.values():
        with open(path, "rb") as stream:
            assert stream.read(8) == b"\x89PNG\r\n\x1a\n"


def test_the_strongest_coordinates_are_drawn_first(machine):
    chosen = diagnosis_pictures.largest_coordinates(example(), machine)
    assert [c.label.split(" ")[0] for c in chosen] == ["side", "drive", "x"]
    assert chosen[0].share == "direction left: 81% of the gap (74% to 88%)"
    without = diagnosis_pictures.largest_coordinates(
        replace(example(), where=(Share("strut", "left_upper", 0.9, 0.8, 1.0),)), machine
    )
    assert [c.label[0] for c in without] == ["x", "y"]


def test_means_over_a_coordinate_leave_out_thin_bins():
    at = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0])
    where, mean, error = diagnosis_pictures.bin_means(at, np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 99.0]))
    np.testing.assert_allclose(where, [0.0, 1.0])
    np.testing.assert_allclose(mean, [2.0, 5.0])
    np.testing.assert_allclose(error, 1.0 / np.sqrt(3.0))
    assert all(len(column) == 0 for column in diagnosis_pictures.bin_means(at[:2], at[:2]))


@pytest.mark.parametrize(("gain_bit", "recommended"), [(0.5, True), (0.0, False), (-0.001, False)])
def test_only_a_campaign_that_promises_something_is_recommended(gain_bit, recommended):
    diagnosis = example()
    addition = replace(diagnosis.next_measurement[0], gain_bit=gain_bit)
    diagnosis = replace(diagnosis, next_measurement=(addition,))
    result = diagnosis_output.diagnosis_json(diagnosis, {addition.name: "FILE.toml"})
    page = io.StringIO()
    Console(file=page, width=120).print(diagnosis_text.describe_diagnosis(diagnosis, result))
    assert "FILE.toml" in page.getvalue()
    assert ("pkm-rig measure --campaign FILE.toml" in page.getvalue()) is recommended
    assert "-0.00" not in page.getvalue()

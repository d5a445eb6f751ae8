"""Profiles of drive makes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.drives.drive_profile import DriveCapabilities, load_profile, parse_profile
from tests.either import either

SHIPPED = ("pkm-mock", "plain-402", "example-high-index", "example-array")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_profiles_can_be_read(name: str) -> None:
    profile = load_profile(name)
    assert (profile.compensation is None) == (name == "plain-402")
    if profile.compensation is not None:
        assert not profile.compensation.activate.reads_back
        assert profile.compensation.banks[0].image.format == ""
        assert profile.compensation.banks[0].image != profile.compensation.banks[1].image


def test_the_mocks_profile_is_the_documents() -> None:
    profile = load_profile("pkm-mock").compensation
    assert profile is not None
    assert (profile.payload.index, profile.payload.sub, profile.payload.format) == (0x2100, 7, "<I")
    assert (profile.banks[1].status.index, profile.banks[1].status.sub) == (0x2102, 5)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("pkm-mock", DriveCapabilities(True, True, True, True, True, True, True)),
        ("plain-402", DriveCapabilities(False, False, False, True, True, False, False)),
        ("example-high-index", DriveCapabilities(True, True, True, True, True, False, False)),
        ("example-array", DriveCapabilities(True, False, False, True, False, False, False)),
    ],
)
def test_what_a_make_can_do_is_known_without_a_drive(name: str, expected: DriveCapabilities) -> None:
    assert load_profile(name).capabilities == expected


def test_modes_that_a_make_does_not_have() -> None:
    text = 'name = "x"\nhoming = false\ncyclic_position = false\n[referenced]\nobject = "0x2103:01 u8"\nmask = 1\n'
    capabilities = parse_profile(text).capabilities
    assert capabilities.referenced_flag
    assert not capabilities.homing
    assert not capabilities.cyclic_position


def test_a_file_beside_the_rig_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "mine.toml").write_text('name = "mine"\nfactor_group = false\n')
    assert not load_profile("mine.toml", tmp_path).factor_group
    with pytest.raises(ValueError, match="cannot be read"):
        load_profile("none.toml", tmp_path)
    with pytest.raises(ValueError, match="plain-402"):
        load_profile("no-such-make")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "name"),
        ("name = 3", "name: str required"),
        ('name = "x"\nhoming = 1', "homing: bool required"),
        ('name = "x"\nspeed = 1', "unknown key 'speed'"),
        ('name = "x"\n[referenced]\nobject = "2103"\nmask = 1', "is not an object such as"),
        ('name = "x"\n[referenced]\nobject = "0x2103:01 f64"\nmask = 1', "is not an object such as"),
        ('name = "x"\n[compensation]\nbanks = []', "two are required"),
        ('name = "x"\n[compensation]\nbanks = [{}, {}]', "bank 1 image"),
        ('name = "x"\ncompensation = 1', "a table is required"),
        ("name = [", ""),
    ],
)
def test_what_is_no_profile_is_said_in_one_line(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match="drive profile here: ") as caught:
        parse_profile(text, "here")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.one_of(st.text(max_size=200), st.from_regex(r'\Aname = "x"\n(\[\[?[a-z.]+\]\]?\n[a-z]+ = .{0,20}\n){0,3}\Z')))
def test_any_text_is_a_profile_or_a_value_error(text: str) -> None:
    profile, complaint = either(lambda: parse_profile(text, "here"), ValueError)
    if profile is not None:
        assert isinstance(profile.name, str)
        assert profile.home_offset_sign in (1, -1)
    else:
        assert complaint is not None
        assert complaint.startswith("drive profile here: ")

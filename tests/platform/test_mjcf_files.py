"""An MJCF from a stranger reaches nothing outside its folder, and expands nothing."""

import os
from pathlib import Path

import pytest

from twin.errors import PlatformError
from twin.platform.mjcf import load_mjcf

BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE mujoco [\n<!ENTITY a "aaaaaaaaaa">\n'
    + "".join(
        f'<!ENTITY {n} "{f"&{p};" * 10}">\n' for p, n in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + ']>\n<mujoco model="&i;"/>\n'
)
OUTSIDE = "which lies outside the platform's folder; copy it into the folder"


def complaint(path: Path) -> str:
    with pytest.raises(PlatformError) as error:
        load_mjcf(path)
    return str(error.value).replace(f"{path.parent}{os.sep}", "")


@pytest.fixture
def platform(tmp_path: Path) -> Path:
    folder = tmp_path / "platform"
    folder.mkdir()
    (tmp_path / "secret.xml").write_text("<mujoco/>")
    return folder / "platform.xml"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_an_entity_bomb_is_refused_unread(platform: Path, encoding: str):
    platform.write_text(BOMB.replace("?>", f' encoding="{encoding}"?>', 1), encoding=encoding)
    assert complaint(platform) == (
        "platform.xml:2: declares a document type, in which entities can grow without bound; "
        "remove <!DOCTYPE ...>"
    )


def test_an_external_entity_is_refused_unread(platform: Path):
    platform.write_text(
        '<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<mujoco model="&x;"/>\n'
    )
    assert complaint(platform).startswith("platform.xml:1: declares a document type")


@pytest.mark.parametrize(
    ("body", "line", "name"),
    [
        ('<include file="../secret.xml"/>', 2, "../secret.xml"),
        ('<asset><model name="m" file="../secret.xml"/></asset>', 2, "../secret.xml"),
        ('<asset><mesh name="m" file="/etc/passwd"/></asset>', 2, "/etc/passwd"),
        ('<asset><texture type="cube" fileright="../a.png"/></asset>', 2, "../a.png"),
        ('<compiler meshdir=".."/><asset><mesh file="a.stl"/></asset>', 2, ".."),
        ('\n<compiler meshdir="a"/><asset><mesh file="../../b.stl"/></asset>', 3, "../../b.stl"),
        ('<include file="link.xml"/>', 2, "link.xml"),
    ],
)
def test_a_file_outside_the_folder_is_refused(platform: Path, body: str, line: int, name: str):
    (platform.parent / "link.xml").symlink_to(platform.parent.parent / "secret.xml")
    platform.write_text(f"<mujoco>\n{body}\n</mujoco>\n")
    assert complaint(platform) == f"platform.xml:{line}: names {name!r}, {OUTSIDE}"


def test_what_is_included_is_looked_at_too(platform: Path):
    platform.write_text('<mujoco><include file="parts.xml"/></mujoco>\n')
    parts = platform.parent / "parts.xml"
    parts.write_text('<mujoco>\n<include file="platform.xml"/>\n<include file="../x"/></mujoco>\n')
    assert complaint(platform) == f"parts.xml:3: names '../x', {OUTSIDE}"


def test_what_is_no_xml_is_refused_with_its_line(platform: Path):
    platform.write_text("<mujoco>\n<body>\n</mujoco>\n")
    assert complaint(platform) == "platform.xml:3: is no XML (mismatched tag); mend it"


def test_files_in_the_folder_are_for_mujoco_to_read(platform: Path):
    platform.write_text('<mujoco model="a"><include file="parts.xml"/></mujoco>\n')
    (platform.parent / "parts.xml").write_text(
        '<mujoco><worldbody><body name="bus"><geom size="1"/></body></worldbody></mujoco>\n'
    )
    assert load_mjcf(platform).body("bus").name == "bus"
    platform.write_text('<mujoco><include file="gone.xml"/></mujoco>\n')
    assert "MuJoCo refuses it" in complaint(platform)


def test_a_file_that_was_changed_is_read_anew_and_so_is_one_that_it_includes(platform: Path):
    part = '<mujoco><worldbody><body name="{}"><geom size="1"/></body></worldbody></mujoco>\n'
    platform.write_text('<mujoco><include file="parts.xml"/></mujoco>\n')
    for name in ("bus", "wheel"):
        (platform.parent / "parts.xml").write_text(part.format(name))
        assert load_mjcf(platform).body(1).name == name
    platform.write_text(part.format("stage"))
    assert load_mjcf(platform).body(1).name == "stage"


def test_what_one_compilation_edits_or_leaves_out_another_has(platform: Path):
    platform.write_text(
        '<mujoco><worldbody><body name="bus"><freejoint/><geom size="1"/><site name="jet"/>'
        '</body></worldbody><actuator><general name="jet" site="jet"/></actuator></mujoco>\n'
    )
    less = load_mjcf(platform, without=["jet"], edits=[lambda spec: spec.body("bus").add_site()])
    assert (less.nu, [less.site(i).name for i in range(less.nsite)]) == (0, [""])
    whole = load_mjcf(platform)
    assert (whole.nu, [whole.site(i).name for i in range(whole.nsite)]) == (1, ["jet"])


MANY = '<worldbody><replicate count="{}"><geom size="1"/></replicate></worldbody>'
INNER = '<replicate count="100"><geom size="1"/></replicate>'
FIELD = '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
PICTURE = '<asset><texture name="t" type="2d" builtin="flat" width="99999" height="99999"/></asset>'


@pytest.mark.parametrize(
    ("body", "made"),
    [
        (MANY.format(100_000), "replicate"),
        (MANY.format("9" * 5000), "replicate"),
        (f'<worldbody><replicate count="100">{INNER}</replicate></worldbody>', "replicate"),
        (FIELD, "hfield"),
        (PICTURE, "texture"),
    ],
    ids=["many", "digits", "within", "hfield", "texture"],
)
def test_an_element_that_grows_without_bound_is_refused_before_mujoco_sees_it(platform, body, made):
    platform.write_text(f"<mujoco>{body}</mujoco>")
    assert complaint(platform).startswith(f"platform.xml:1: <{made}> makes more than")


def test_replicas_that_stand_one_after_the_other_do_not_multiply(platform: Path):
    body = '<replicate count="900" offset="1 0 0"><geom size=".1"/></replicate>' * 2
    platform.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    assert load_mjcf(platform).ngeom == 1800


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes by name there")
@pytest.mark.parametrize("name", ["platform.xml", "other.xml", "mesh.obj"])
def test_a_pipe_in_place_of_a_file_is_refused_and_not_waited_for(platform: Path, name: str):
    body = '<asset><mesh file="mesh.obj"/></asset><include file="other.xml"/>'
    platform.write_text(f"<mujoco>{body}</mujoco>")
    for other in ("other.xml", "mesh.obj"):
        platform.with_name(other).write_text("<mujoco/>")
    platform.with_name(name).unlink()
    os.mkfifo(platform.with_name(name))
    assert f"{name} is no regular file" in complaint(platform)


def test_an_mjcf_of_many_megabytes_is_refused(platform: Path):
    platform.write_text(f"<mujoco>{' ' * (9 << 20)}</mujoco>")
    assert "holds more than 8 MiB" in complaint(platform)

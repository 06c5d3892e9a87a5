"""A campaign in one piece: what a machine without its files needs to fly any of its shards.

The specification as it was read, with the files of its machines and of its laws, and what else its
bits depend on, so that a machine with another version of it can be told.
"""

import hashlib
import pickle
import zlib
from dataclasses import replace
from pathlib import Path

import twin
from twin.campaigns.folder import hash_of, versions
from twin.campaigns.spec import Arm, Spec
from twin.effects import file_of
from twin.errors import CampaignError, TwinError
from twin.library import find_controller
from twin.platform import Platform, files_of

LARGEST = 1 << 25
"""Bytes of all files: they travel with each shard."""

_SHIPPED = ("models", "controllers")
"""In an installed package; in a checkout they lie beside it, and those of a campaign travel."""


class OtherVersions(TwinError):
    """A machine on which the same runs might not come to the same bits."""


def packed(spec: Spec) -> bytes:
    """The campaign, to be sent.

    Raises:
        CampaignError: its machines' files are more than can travel.
    """
    files: dict[str, bytes] = {}
    arms = [_packed_arm(spec, arm, files) for arm in spec.arms]
    total = sum(map(len, files.values()))
    if total > LARGEST:
        raise CampaignError(
            spec.path,
            f"its machines' files hold {total / 1e6:.0f} MB, which would travel with each shard",
            f"make the meshes and textures that its MJCF names smaller, below "
            f"{LARGEST / 1e6:.0f} MB in all",
        )
    # apart, so that it is opened only where its classes are those that it was made of
    inner = pickle.dumps(replace(spec, arms=tuple(arms)))
    return zlib.compress(pickle.dumps((code_of(), _effects_of(spec), files, inner)))


def unpacked(data: bytes, folder: Path) -> Spec:
    """The campaign, with its files laid out in a folder.

    Raises:
        OtherVersions: this machine's packages are not those that it was packed with, or it lacks
            an effect's file.
    """
    made_by: dict[str, str]
    effects: dict[Path, str]
    files: dict[str, bytes]
    made_by, effects, files, inner = pickle.loads(zlib.decompress(data))
    here = code_of()
    for name, wanted in made_by.items():
        if (found := here.get(name)) != wanted:
            raise OtherVersions(
                f"{name} is {found} there and {wanted} here; install the same, for others come to "
                "other bits"
            )
    for path, wanted in effects.items():
        if not path.is_file() or hash_of(path) != wanted:
            what = "another file there" if path.is_file() else "not there"
            raise OtherVersions(
                f"the effect {path} is {what}; effects of one's own do not travel: put the same "
                "file in the same place"
            )
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    spec: Spec = pickle.loads(inner)
    return replace(spec, arms=tuple(_laid_out(arm, folder) for arm in spec.arms))


def code_of() -> dict[str, str]:
    """What runs depend on beside their files: packages by version, our own code by its hash."""
    root = Path(twin.__file__).parent
    sources = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in _SHIPPED:
            sources.update(f"{name.as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return {**versions(), "code of airbearing-twin": sources.hexdigest()[:12]}


def _effects_of(spec: Spec) -> dict[Path, str]:
    """Files of effects that are not in the package, whose classes are found by them."""
    own = (file_of(effect.kind) for arm in spec.arms for effect in arm.effects)
    return {path: hash_of(path) for path in own if path is not None}


def _packed_arm(spec: Spec, arm: Arm, files: dict[str, bytes]) -> Arm:
    """The arm with paths from where its files are laid out; those are added to `files`."""
    platform = _packed_platform(arm.platform, files)
    known = replace(arm.known, folder=platform.folder, model_path=platform.model_path)
    if spec.procedure == "balance":
        return replace(arm, platform=platform, known=known)
    content = (law := find_controller(arm.controller)).read_bytes()
    name = f"laws/{hashlib.sha256(content).hexdigest()[:12]}/{law.name}"
    files[name] = content
    return replace(arm, platform=platform, known=known, controller=name)


def _packed_platform(platform: Platform, files: dict[str, bytes]) -> Platform:
    mark = hashlib.sha256(str(platform.folder).encode()).hexdigest()[:12]
    place = Path("machines") / mark / platform.folder.name
    for name, path in files_of(platform).items():
        files[(place / name).as_posix()] = path.read_bytes()
    model = place / platform.model_path.relative_to(platform.folder)
    return replace(platform, folder=place, model_path=model)


def _laid_out(arm: Arm, folder: Path) -> Arm:
    def moved(platform: Platform) -> Platform:
        return replace(
            platform, folder=folder / platform.folder, model_path=folder / platform.model_path
        )

    law = folder / arm.controller
    return replace(
        arm,
        platform=moved(arm.platform),
        known=moved(arm.known),
        controller=str(law) if law.is_file() else arm.controller,
    )

"""A packed campaign flies where none of its files are, to the same rows, or says why not."""

import pickle
import shutil
import zlib
from pathlib import Path

import pytest

from tests.campaigns.conftest import GOOD
from tests.conftest import FAN
from twin.campaigns import cluster
from twin.campaigns.cluster import Sent, ShardRefused, fly_sent, packed
from twin.campaigns.read import read_spec
from twin.campaigns.spec import Spec
from twin.campaigns.worker import rows_of_shard
from twin.errors import CampaignError
from twin.files import trust_folders
from twin.library import library


@pytest.fixture
def own(tmp_path: Path) -> Spec:
    """A campaign of a machine and a law of somebody's own."""
    shutil.copytree(library("models") / "cubesat", tmp_path / "mine")
    shutil.copy(library("controllers") / "mass_magnetic_pid.py", tmp_path / "law.py")
    text = GOOD.replace('"cubesat"', f'"{tmp_path / "mine"}"')
    text = text.replace('"mass_magnetic_pid"', f'"{tmp_path / "law.py"}"')
    (tmp_path / "spec.toml").write_text(text, encoding="utf-8")
    trust_folders(tmp_path)
    return read_spec(tmp_path / "spec.toml")


def test_a_packed_campaign_flies_where_none_of_its_files_are(own, tmp_path):
    done, rows = rows_of_shard(own, 2)
    campaign = packed(own)
    for path in (tmp_path / "mine").rglob("*"):
        path.unlink()
    for name in ("law.py", "spec.toml"):
        (tmp_path / name).unlink()
    sent = fly_sent(campaign, 2)
    assert isinstance(sent, Sent), sent
    assert sent.done == done
    assert sent.rows.equals(rows, check_metadata=True)


def test_a_balancing_travels_too(tmp_path):
    file = tmp_path / "spec.toml"
    text = 'platform = "cubesat"\nprocedure = "balance"\ncontroller = "direct"\nruns = 2\n'
    file.write_text(text + "duration = 2.0\nseed = 3\n", encoding="utf-8")
    spec = read_spec(file)
    sent = fly_sent(packed(spec), 0)
    assert isinstance(sent, Sent), sent
    assert sent.rows.equals(rows_of_shard(spec, 0)[1])


def test_what_the_mjcf_does_not_name_stays_at_home(own, tmp_path):
    before = len(packed(own))
    for name in ("logs", ".git", "an earlier campaign"):
        (tmp_path / "mine" / name).mkdir(exist_ok=True)
        (tmp_path / "mine" / name / "big").write_bytes(bytes(range(256)) * 1000)
    assert len(packed(own)) == before


def test_files_that_are_too_large_to_travel_are_told(own, monkeypatch):
    monkeypatch.setattr(cluster, "LARGEST", 1000)
    with pytest.raises(CampaignError, match="would travel with each shard"):
        packed(own)


@pytest.mark.parametrize("name", ["mujoco", "code of airbearing-twin"])
def test_a_machine_with_other_versions_refuses_to_fly(own, name):
    made_by, *rest = pickle.loads(zlib.decompress(packed(own)))
    other = zlib.compress(pickle.dumps(({**made_by, name: "1.0"}, *rest)))
    refused = fly_sent(other, 0)
    assert isinstance(refused, ShardRefused)
    assert f"{name} is {made_by[name]} there and 1.0 here" in refused.sentence


@pytest.mark.parametrize("there", ["", "# another\n"], ids=["missing", "another"])
def test_an_effect_of_ones_own_that_is_not_the_same_there_is_refused(tmp_path, there):
    fan, file = tmp_path / "fan.py", tmp_path / "spec.toml"
    trust_folders(tmp_path)
    fan.write_text(FAN)
    file.write_text(GOOD + f"[effects.'{fan}']\n")
    campaign = packed(read_spec(file))
    fan.unlink()
    if there:
        fan.write_text(FAN + there)
    refused = fly_sent(campaign, 0)
    assert isinstance(refused, ShardRefused)
    assert f"the effect {fan} is " in refused.sentence

"""The page of the files that are read: `python tests/intake/corpus.py` writes docs/formats.md.

Every layout is written with a motion that is known, imported unedited and read back; the page says
which streams came out, and by how much the worst of their values differs from the source.
"""

import argparse
import tempfile
from pathlib import Path

import devices
import makers
import numpy as np

from twin.errors import LogError
from twin.intake import import_files
from twin.platform import load_platform
from twin.recording import Recording, read_log

LAYOUTS = (*makers.MAKERS, *devices.DEVICES)
PAGE = Path(__file__).parents[2] / "docs" / "formats.md"
HEAD = """# Files that are read

Written by `python tests/intake/corpus.py`; `tests/intake/test_import.py` holds it.

Each file is written in its maker's layout with one motion of 20 s at 50 Hz (seed {seed}) and goes
through `twin import` unedited, without a platform. `worst` is the largest difference of any value
from the source, in SI (quaternions, rad/s, m/s^2, T, m): the digits that the layout has. The last
rows are other labs' own files, as shipped; their values are held against the shipped log.toml.

| layout | file | streams | worst |
|---|---|---|---|
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=40)
    parser.add_argument("--page", type=Path, default=PAGE)
    options = parser.parse_args()
    motion = makers.motion(options.seed)
    rows = [row_of(maker, motion) for maker in LAYOUTS]
    rows += [row_of_real(log, machine) for log, machine in makers.REAL]
    opened = sum("| refused: " not in row for row in rows)
    share = 100.0 * opened / len(rows)
    count = f"{opened} of {len(rows)} are opened ({share:.0f} %)"
    tail = f"\n{count}; of the others the sentence says why.\n"
    text = HEAD.format(seed=options.seed) + "\n".join(rows) + "\n" + tail
    options.page.write_text(text, encoding="utf-8")
    return 0


def row_of(maker: makers.Maker, motion: makers.Motion) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / maker.file
        kind = f"`{path.suffix}`" if path.suffix else "folder"
        maker.write(path, motion)
        try:
            import_files([path], Path(folder) / "log", None, None)
        except LogError as problem:
            said = str(problem).replace(f"{folder}/", "").partition("; write a log.toml")[0]
            return f"| {maker.name} | {kind} | refused: {said} | |"
        log = read_log(Path(folder) / "log")
        worst = max(difference(log, name, motion) for name in maker.streams)
    return f"| {maker.name} | {kind} | {', '.join(maker.streams)} | {worst:.1g} |"


def row_of_real(log: str, machine: str | None) -> str:
    source = makers.MODELS / log
    files = [source / name for name in makers.files_of(source)]
    platform = None if machine is None else load_platform(machine)
    shipped = read_log(source)
    with tempfile.TemporaryDirectory() as folder:
        import_files(files, Path(folder) / "log", platform, machine)
        found = read_log(Path(folder) / "log")
    worst = max(float(np.abs(found[n].value - shipped[n].value).max()) for n in shipped)
    return f"| models/{log} | `{files[0].suffix}` | {', '.join(shipped)} | {worst:.1g} |"


def difference(log: Recording, name: str, motion: makers.Motion) -> float:
    """The largest difference of a stream's values from what was true."""
    series, true = log[name], getattr(motion, name)
    kept = np.isin(np.round(makers.RATE * motion.time), np.round(makers.RATE * series.time))
    true = true[kept] if len(series) < len(true) else true
    if name == "attitude":
        true = true * np.sign(np.sum(true * series.value, axis=1))[:, None]
    return float(np.abs(series.value - true).max())


if __name__ == "__main__":
    raise SystemExit(main())

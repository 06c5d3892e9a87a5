"""The pictures of the README, made by the twin itself: `python docs/pictures.py`."""

from pathlib import Path

import twin

IMAGES = Path(__file__).parent / "images"


def main() -> None:
    """Fly a table whose bearing rubs, and diagnose the log by a model without friction."""
    run = twin.fly(
        "sads",
        "quaternion_pd",
        reference="multisine:10@0.05",
        duration=60.0,
        effects="bearing_viscous_friction=0.2",
        seed=1,
    )
    diagnosis = twin.diagnose(run.recording, "sads")
    print(diagnosis)
    diagnosis.save(IMAGES / "diagnosis.png")


if __name__ == "__main__":
    main()

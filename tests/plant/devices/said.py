"""What the drives of a line say, answer by answer, without a line."""

from collections.abc import Sequence


class Said:
    """In the place of a `Line`; each question takes the next answer."""

    heard = wire = 0.0

    def __init__(self, *answers: tuple[int, ...] | None) -> None:
        """`answers`: values of the items that are asked for; None: no answer."""
        self.answers = list(answers)
        self.asked: list[tuple[str, ...]] = []
        self.told: list[str] = []

    def ask(
        self, address: str, items: Sequence[str], mode: object, tries: int = 3
    ) -> tuple[int, ...] | None:
        """The next answer; a question that may be asked again takes several that are missing."""
        for _ in range(tries):
            self.asked.append(tuple(items))
            answer = self.answers.pop(0)
            if answer is not None:
                return answer
        return None

    def tell(self, address: str, command: str, mode: object, tries: int = 3) -> bool:
        """Note a command; it is acknowledged."""
        self.told.append(command)
        return True

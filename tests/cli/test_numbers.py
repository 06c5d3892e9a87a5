"""A number that is none, or that no machine could have, is refused before anything is done."""

import pytest

from twin.cli.main import main

FINITE, TRIPLE = "give a finite number", "give finite numbers"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run sads --duration nan", f"--duration is nan; {FINITE}"),
        ("run sads --duration inf", f"--duration is inf; {FINITE}"),
        (
            "run sads --duration 1e308",
            "duration is 1e+308 s; give a time above zero, 1e+06 s at most",
        ),
        (
            "balance sads --duration 0",
            "duration is 0 s; give a time above zero, 1e+06 s at most",
        ),
        ("run sads --seed -1", "--seed is -1; give 0 or more"),
        ("run sads --attitude nan 0 0", f"--attitude is nan 0 0; {TRIPLE}"),
        ("run sads --rate 0 nan 0", f"--rate is 0 nan 0; {TRIPLE}"),
        ("run sads --velocity 0 0 inf", f"--velocity is 0 0 inf; {TRIPLE}"),
        ("balance sads --duration nan", f"--duration is nan; {FINITE}"),
        ("balance sads --seed -1", "--seed is -1; give 0 or more"),
        ("balance sads --offset 0 0 nan", f"--offset is 0 0 nan; {TRIPLE}"),
        ("balance sads --stages nan 0 0", f"--stages is nan 0 0; {TRIPLE}"),
        ("emulate cubesat --attitude nan 0 0", f"--attitude is nan 0 0; {TRIPLE}"),
        ("emulate cubesat --duration nan", f"--duration is nan; {FINITE}"),
        ("emulate cubesat --seed -1", "--seed is -1; give 0 or more"),
        ("doctor --seconds nan", f"--seconds is nan; {FINITE}"),
        ("identify LOG --corner nan", f"--corner is nan; {FINITE}"),
        ("identify LOG --forgetting inf", f"--forgetting is inf; {FINITE}"),
        ("hardware sads jog s1 nan --floating", f"MM is nan; {FINITE}"),
    ],
)
def test_a_number_that_nothing_can_have_is_told_with_its_option_and_exit_code_2(
    words: str, sentence: str, capsys: pytest.CaptureFixture[str]
):
    assert main(words.split()) == 2
    told = capsys.readouterr()
    assert told.err == f"twin: {sentence}\n"
    assert told.out == "", "nothing was begun"

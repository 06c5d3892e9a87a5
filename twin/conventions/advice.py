"""What to tell a person about a log's conventions, and what to write into its log.toml."""

from dataclasses import dataclass

from twin.conventions.finding import ConventionFinding, opened
from twin.conventions.log_toml import corrected_lines
from twin.conventions.search import check_conventions
from twin.platform import Platform
from twin.recording import Recording


@dataclass(frozen=True)
class ConventionAdvice:
    """Nothing in it: the log looks read rightly."""

    findings: tuple[ConventionFinding, ...]
    sentences: tuple[str, ...]
    """One for each thing that is wrong; one for all that several readings explain equally well."""
    log_toml: str
    """Lines to add to log.toml, or to change there; empty where none is sure."""
    exported: bool
    """Whether the log has a log.toml only after `twin export`."""

    @property
    def text(self) -> str:
        """Sentences and lines, as they are printed; empty without findings."""
        lines = list(self.sentences)
        if self.log_toml:
            where = "log.toml"
            if self.exported:
                where = "the log.toml that `twin export` writes of it"
            lines += [f"To read it so, write in {where}:"]
            lines += [f"  {line}" for line in self.log_toml.splitlines()]
        return "\n".join(lines)

    @property
    def warning(self) -> str:
        """One sentence for those who asked for something else; empty without findings."""
        if not self.sentences:
            return ""
        said = " ".join(self.sentences)
        return f"The log looks misread, so what follows may be wrong: {said} `twin show` says more."


def convention_advice(recording: Recording, platform: Platform | None) -> ConventionAdvice:
    """Look at a log's conventions, and say what to do; without a platform the wheels are not
    checked."""
    findings = check_conventions(recording, platform)
    sure = [finding for finding in findings if not finding.ambiguous]
    open_ones = [finding for finding in findings if finding.ambiguous]
    sentences = [finding.sentence for finding in sure]
    for others in dict.fromkeys(finding.alternatives for finding in open_ones):
        together = [f.correction.words for f in open_ones if f.alternatives == others]
        words = "; or ".join([", and ".join(together), *others])
        sentences.append(f"{opened(words)}: the log does not tell which.")
    lines = corrected_lines(recording, (c for finding in sure for c in finding.corrections))
    exported = recording.provenance.get("kind") != "log"
    return ConventionAdvice(tuple(findings), tuple(sentences), "\n".join(lines), exported)

"""What a page says of a study's report: whether there is one, how old it is, and what a table does not hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.dashboard.words import parameter_name
from service.db.dashboard_reads import StudySnapshot
from service.db.models import ReportRow, StudyRow
from service.domain.states import JobKind, is_over


class ReportedStudy:
    """Shared by the pages of a study; `known` is its newest report."""

    snapshot: StudySnapshot
    known: ReportRow | None

    @property
    def study(self) -> StudyRow:
        return self.snapshot.study

    @property
    def is_over(self) -> bool:
        return is_over(self.study.state)

    @property
    def is_settled(self) -> bool:
        """Nothing on the page changes any more: the study is over, and so is its report."""
        return self.is_over and not self.report_is_open

    @property
    def report(self) -> Mapping[str, Any] | None:
        return None if self.known is None else self.known.content

    @property
    def report_says_enough(self) -> bool:
        """It has a posterior. An imported study's report is whatever its file held."""
        report = self.report or {}
        posterior = report.get("posterior")
        return (
            bool(report.get("enough"))
            and isinstance(posterior, Mapping)
            and {"parameters", "text"} <= set(posterior)
        )

    @property
    def report_is_open(self) -> bool:
        return any(job.job.kind is JobKind.REPORT for job in self.snapshot.jobs)

    @property
    def report_is_current(self) -> bool:
        """It knows every design that has ended."""
        if self.known is None:
            return False
        return all((row.ended_at or 0.0) <= self.known.created_at for row in self.snapshot.designs)

    @property
    def report_is_whole(self) -> bool:
        """Reports of version 1 hold neither draws nor every pair of variables, which the analysis shows."""
        return not self.report_says_enough or "draws" in (self.report or {})["posterior"]

    @property
    def report_sentences(self) -> list[str]:
        """What a table does not hold: combinations that are fixed where their members are not, the next test."""
        report = self.report or {}
        combined = [text for text in report["posterior"]["text"] if text.startswith("Identified only")]
        tests = [f"Test next: {test['text']}" for test in report.get("which_test_next", ())[:2]]
        return [self._in_words(text) for text in (*combined, *tests)]

    def _in_words(self, text: str) -> str:
        """With the parameters' names as the columns have them."""
        for name in sorted(self.study.spec["variables"], key=len, reverse=True):
            text = text.replace(name, parameter_name(name))
        return text

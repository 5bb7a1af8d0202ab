"""Counts the skipped tests at the end of a run, and fails it when one was not expected."""

from collections import Counter
from collections.abc import Generator

import pytest
from expected_skips import is_expected


class SkipReport:
    """Collects every skip of a run, of tests and of whole modules."""

    def __init__(self) -> None:
        self.expected: Counter[str] = Counter()
        self.unexpected: list[str] = []

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if not report.skipped or hasattr(report, "wasxfail"):
            return
        # A skip's longrepr is (file, line, "Skipped: reason").
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
        reason = reason.removeprefix("Skipped: ")
        if is_expected(reason):
            self.expected[reason] += 1
        else:
            self.unexpected.append(f"{report.nodeid}: {reason}")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A test's phase is over."""
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A module is collected."""
        self._note(report)

    @pytest.hookimpl(wrapper=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Generator[None]:
        """Fails the run before the terminal sums it up."""
        if self.unexpected and session.exitstatus in (
            pytest.ExitCode.OK,
            pytest.ExitCode.NO_TESTS_COLLECTED,
        ):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        yield

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """One section, right above the closing line."""
        count = self.expected.total() + len(self.unexpected)
        title = f"SKIPPED: {count}, of these unexpected: {len(self.unexpected)}"
        terminalreporter.section(title, red=bool(self.unexpected), yellow=bool(self.expected))
        for reason, times in self.expected.items():
            terminalreporter.line(f"{times} x {reason}")
        for line in self.unexpected:
            terminalreporter.line(f"UNEXPECTED, fails the run: {line}", red=True)


def pytest_configure(config: pytest.Config) -> None:
    """Adds the report to a run."""
    config.pluginmanager.register(SkipReport(), "volillum-skips")

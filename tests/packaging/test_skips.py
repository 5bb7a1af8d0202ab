"""A skip is counted at the end; one that `expected_skips` does not list fails the run."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
TESTS = Path(__file__).resolve().parents[1]


def run(pytester: pytest.Pytester, body: str) -> pytest.RunResult:
    """A run of its own over one test module, with the project's plugin."""
    pytester.makeini(f"[pytest]\npythonpath = {TESTS}\n")
    pytester.makeconftest('pytest_plugins = ["plugins.skips"]')
    pytester.makepyfile(body)
    return pytester.runpytest_subprocess()


def test_an_unexpected_skip_fails_the_run(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        import pytest

        def test_passes():
            pass

        def test_drops_out():
            pytest.skip("not today")
        """,
    )
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(
        ["*SKIPPED: 1, of these unexpected: 1*", "*test_drops_out: not today", "*1 passed, 1 sk*"]
    )


def test_an_unexpected_skip_of_a_module_fails_the_run(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        import pytest

        pytest.importorskip("no_such_module_anywhere")
        """,
    )
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["*SKIPPED: 1, of these unexpected: 1*"])


def test_an_expected_skip_is_counted_and_passes(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("VOLILLUM_DATA", raising=False)
    result = run(
        pytester,
        """
        from expected_skips import third_party_data

        def test_passes():
            pass

        def test_needs_data():
            third_party_data("volume")
        """,
    )
    assert result.ret == pytest.ExitCode.OK
    result.stdout.fnmatch_lines(
        ["*SKIPPED: 1, of these unexpected: 0*", "1 x *VOLILLUM_DATA*", "*1 passed, 1 skipped*"]
    )


def test_missing_data_in_a_named_folder_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from expected_skips import third_party_data

    monkeypatch.setenv("VOLILLUM_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="no volume"):
        third_party_data("volume")


def test_a_reason_must_be_listed() -> None:
    from expected_skips import skip

    with pytest.raises(KeyError):
        skip("because")

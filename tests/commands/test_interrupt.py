"""Ctrl-C is remembered where a library swallows it."""

import contextlib
import signal

import pytest

from acp_lab import cli
from acp_lab.commands import interrupt


def test_a_swallowed_key_is_not_lost() -> None:
    with interrupt.remembered():
        interrupt.check()
        with contextlib.suppress(KeyboardInterrupt):  # as libraries do around optional imports
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interrupt.check()
        interrupt.check()  # once


def test_the_old_handler_comes_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupt.remembered():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_a_command_that_swallowed_the_key_exits_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def swallow() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return 0

    monkeypatch.setattr("acp_lab.commands.doctor.print_report", swallow)
    assert cli.main(["doctor"]) == 130

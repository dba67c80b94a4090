"""The rules that the benchmark leaves out are those that the judge goes by."""

import importlib

import pytest

from benchmarks.verdict.rules import RULES, Constant, Rule, leave_out


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.says)
def test_every_rule_has_constants_that_its_absence_changes(rule: Rule) -> None:
    assert rule.constants
    for module, name, value in rule.constants:
        assert getattr(importlib.import_module(module), name) != value


def test_a_constant_that_is_gone_is_an_error_and_no_rule_without_effect() -> None:
    gone = Rule(0, "nothing", (Constant("chatter_monitor.kernels.kinds", "NO_SUCH", 0.0),))
    with pytest.raises(AttributeError, match="has no NO_SUCH"):
        leave_out(gone)

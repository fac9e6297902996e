"""The changes that mutants are made by."""

import ast

import pytest
from operators import mutations

PYTHON = '''
def bound(a, error):
    """Sum + text."""
    if error < np.abs(a[0]).max():
        raise ValueError("a" + "b")
    return 2 * error + rounding(a)
'''
SLANG = """
double bound(double a, double error) // a + b
{
    double values[4];
    return min(2.0lf * error + rounding(a, 1) - abs(a), values[0]);
}
"""


@pytest.mark.parametrize(
    ("suffix", "text", "changes"),
    [
        (
            ".py",
            PYTHON,
            {
                "if error <= np.abs(a[0]).max():",
                "if error < (a[0]).max():",
                "if error < np.abs(a[0]).min():",
                "if error < np.abs(a[1]).max():",
                "return 2 * error - rounding(a)",
                "return (2 * error)",
                "return (rounding(a))",
                "return (0.5 * (2 * error)) + rounding(a)",
            },
        ),
        (
            ".slang",
            SLANG,
            {
                "return max(2.0lf * error + rounding(a, 1) - abs(a), values[0]);",
                "return min(1.0lf * error + rounding(a, 1) - abs(a), values[0]);",
                "return min(2.0lf * error - rounding(a, 1) - abs(a), values[0]);",
                "return min(2.0lf * error + rounding(a, 1) + abs(a), values[0]);",
                "return min(2.0lf * error + rounding(a, 1), values[0]);",
                "return min(2.0lf * error - abs(a), values[0]);",
                "return min(2.0lf * error + rounding(a, 1) - (a), values[0]);",
                "return min(2.0lf * error + rounding(a, 1) - abs(a), values[1]);",
            },
        ),
    ],
)
def test_mutations_change_one_place_of_the_code(suffix, text, changes):
    found = set()
    for change in mutations(text, suffix):
        lines = change.apply(text).splitlines()
        assert text.splitlines()[change.line - 1] != lines[change.line - 1]
        found.add(lines[change.line - 1].strip())
        if suffix == ".py":
            ast.parse(change.apply(text))
    assert found == changes

"""Formulas in files: what they are worth, where they are wrong, and that nothing else can be smuggled in."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atc.config.formula import FUNCTIONS, Formula, Influence
from atc.errors import AtcError


@pytest.mark.parametrize(
    "text, want",
    [
        ("16.5*min(t/1e-6, 1)", 16.5 * 0.25),
        ("-t**2", -(0.25e-6**2)),
        ("2**-1 + 7 % 4 - +1", 2.5),
        ("where(t < 1e-6, 1, 1/0)", 1.0),
        ("3 if 0 < t <= 1e-7 else 4", 4.0),
        ("step(t) + step(-t) + step(0)", 1.5),
        ("heaviside(t) + heaviside(-t) + heaviside(0)", 1.5),
        ("2^3 + -x^2 + 2^-1 + 2^3^0", 8 - 9 + 0.5 + 2),
        ("1e3*(t^0)**2 + e^0", 1001.0),
        ("(t > 0 and not t > 1) + (t < 0 or t == 0)", 1.0),
        ("max(1, 2, x)", 3.0),
        ("sin(pi/2)*exp(log(2)) + sqrt(16) + abs(-1)", 7.0),
        ("atan2(1, -1) + floor(1.5) + ceil(1.5) + sign(-2) + log10(100)", 0.75 * math.pi + 4),
        (" \n x \n + 1", 4.0),
    ],
)
def test_values(text, want):
    assert float(Formula(text, ("t", "x"))(t=0.25e-6, x=3.0)) == pytest.approx(want, rel=1e-15)


def test_arrays():
    x = np.linspace(-1, 1, 5)
    f = Formula("where(x < 0, -x, 2*x)*t", ("t", "x", "y"))
    assert np.array_equal(f(t=3.0, x=x, y=x), np.where(x < 0, -x, 2 * x) * 3) and f.uses == {"t", "x"}


@given(st.recursive(
    st.sampled_from(["t", "x", "2.5", "pi"]),
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from(["+", "-", "*"]), inner), st.builds("{}({})".format, st.sampled_from(["sin", "cos", "abs", "exp"]), inner),
        st.builds("-{}".format, inner), st.builds("min({}, {})".format, inner, inner),
    ), max_leaves=12,
))  # fmt: skip
def test_python_agrees(text):
    values = {"t": 0.3, "x": -1.7}
    with np.errstate(all="ignore"):
        want = eval(
            text,
            {"__builtins__": {}},
            {**values, "pi": np.pi, "sin": np.sin, "cos": np.cos, "abs": np.abs, "exp": np.exp, "min": np.minimum},
        )
    assert np.array_equal(Formula(text, ("t", "x"))(**values), np.asarray(want, float), equal_nan=True)


@pytest.mark.parametrize(
    "text, words",
    [
        ("", "empty"),
        ("16.5*mni(t, 1)", r"character 6: unknown function 'mni': did you mean 'min'"),
        ("  2*v", r"character 5: unknown 'v'.*known: t, x, pi, e"),
        ("t^2 + mni(t^2, 1)", "character 7: unknown function 'mni'"),
        ("t^2 + 3^(t", "character 9: this is not a formula"),
        ("t^^2", "not a formula"),
        ("2*(t", "character 3: this is not a formula"),
        ("t t", "character 1: this is not a formula|character 3"),
        ("sin", r"character 1: sin is a function: write sin\(...\)"),
        ("sin(t, 1)", "character 1: sin takes 1 argument"),
        ("min(t)", "min takes 2 or more"),
        ("where(t)", "where takes 3 arguments"),
        ("'a'", "expected a number"),
        ("1e999", "too large"),
        ("9" * 400, "too large"),
        ("1j*t", "expected a number"),
        ("True", "expected a number"),
        ("t.real", "character 1: only arithmetic"),
        ("t[0]", "only arithmetic"),
        ("[t, 1]", "only arithmetic"),
        ("(lambda: 1)()", "only functions by their names"),
        ("[c for c in (1, 2)]", "only arithmetic"),
        ("__import__('os')", "unknown function '__import__'"),
        ("t.__class__.__bases__", "only arithmetic"),
        ("(t := 1)", "only arithmetic"),
        ("min(*t)", "min takes"),
        ("sin(x=t)", "sin takes"),
        ("f'{t}'", "only arithmetic|expected a number"),
        ("t is 1", "only arithmetic"),
        ("αβ*mni(1, 2)", r"character 1: unknown 'αβ'"),
        ("t + α*0 + mni(1, 2)", r"character 5: unknown 'α'"),
        ("t; t", "not a formula"),
        ("+" * 1900 + "t", "nested too deeply"),
        ("1" + "+t" * 300, "nested too deeply"),
        ("t+" * 2000 + "t", "more than 2000 characters"),
    ],
)  # fmt: skip
def test_mistakes_have_a_place(text, words):
    with pytest.raises(ValueError, match=words) as e:
        Formula(text, ("t", "x"))
    assert "\n" not in str(e.value) and len(str(e.value)) < 400


def test_what_is_not_finite_is_named():
    f = Formula("1/(t - 1) + sqrt(x)", ("t", "x"))
    assert float(f.finite(AtcError, t=2.0, x=4.0)) == 3.0
    with pytest.raises(AtcError, match=r'"1/\(t - 1\) \+ sqrt\(x\)" is inf at t = 1, x = 4'):
        f.finite(AtcError, t=1.0, x=4.0)
    with pytest.raises(AtcError, match="is nan at t = 2, x = -1"):
        f.finite(AtcError, t=2.0, x=np.array([1.0, -1.0]))
    with pytest.raises(AtcError, match='"1/0" is not finite'):
        Formula("1/0").finite(AtcError, t=0.0)


def test_equal_texts_are_equal_formulas():
    assert (
        Formula("t") == Formula("t") != Formula("t + 0")
        and Formula("t") != Formula("t", ("t", "x"))
        and len({Formula("t"), Formula("t")}) == 1
    )
    assert set(FUNCTIONS) >= {"sin", "cos", "exp", "sqrt", "min", "max", "abs", "where"}


def test_influence_functions_of_vectors():
    from atc.config.formula import influence

    w = influence("x^2 + r/delta", 4.0, unit=10.0)
    np.testing.assert_allclose(w(np.array([[10.0, 0, 0], [0, -20.0, 0]])), [1 + 2.5, 5.0], rtol=1e-14)
    assert w == influence("x^2 + r/delta", 4.0, 10.0) != influence("x^2 + r/delta", 5.0, 10.0)
    assert len({w, influence("x^2 + r/delta", 4.0, 10.0), influence("x^2 + r/delta", 4.0)}) == 2
    plain = influence("r", 4.0, unit=10.0)
    assert plain(np.array([20.0]), 4.0) == 2.0 and plain != influence("r", 4.0)


def test_influence_functions():
    w = Influence("1 - r/delta")
    assert np.array_equal(w(np.array([0.0, 1.0, 2.0]), 4.0), [1.0, 0.75, 0.5]) and np.array_equal(
        Influence("1")(np.zeros(3), 1.0), np.ones(3)
    )
    with pytest.raises(AtcError, match="negative at r = 5"):
        w(np.array([1.0, 5.0]), 4.0)
    with pytest.raises(AtcError, match="influence: .*inf at delta = 4, r = 0|influence: .*inf at r = 0"):
        Influence("delta/r")(np.array([0.0]), 4.0)

# SPDX-License-Identifier: BSD-3-Clause
"""Parts of an impact table that boulders use: those adjacent in size and relief, also if the
strength of the ground varies between boulders. Tables have parts that can be identified."""

import numpy as np
import pytest

import rockfall
from made import every_third, refused
from rockfall.grounds.impact_tables import (
    EDGES,
    FIELDS,
    INPUTS,
    MAPPED,
    ImpactTable,
    YieldingGround,
    save_table,
)
from rockfall.result.trajectories import vertices_of
from scenes import grid

G, DENSITY = 9.81, 2700.0
COLUMNS, ROWS = (0.001, 0.004, 0.02), (8.0, 12.0, 20.0)
STRENGTH = 2e6  # strength of the ground in coded tables [Pa]


def volume_of(radius):
    return float(4 / 3 * np.pi * radius**3)


def radius_of(size):
    """R_b [m] of a boulder of DENSITY for which rho g R_b is `size` times STRENGTH."""
    return size * STRENGTH / (DENSITY * G)


def coded_table(path, ground, columns=COLUMNS, rows=ROWS):
    """Write a table whose parts can be identified: part k gives V_n = code(k) |V| and stops all
    other motion. Return its name."""
    parts = len(columns) * len(rows)
    record = np.zeros((2 * parts, len(FIELDS)), "f4")
    speed = FIELDS.index("speed_in")
    record[:, :2], record[:, speed] = (1.0, -1.0), np.sqrt(2.0)
    record[:, FIELDS.index("vn_out")] = record[:, speed] * np.repeat(code(np.arange(parts)), 2)
    edges = {name: np.zeros((parts, *(1,) * (int(name[-1]) - 1), 0), "f4") for name in EDGES}
    table = ImpactTable(
        size=np.array(columns), relief=np.array(rows), edges=edges,
        first=np.arange(2 * parts + 1), map=np.zeros((2 * parts, MAPPED, INPUTS)),
        low=np.full((2 * parts, INPUTS), -99.0), high=np.full((2 * parts, INPUTS), 99.0),
        record=record, inertia=0.4, ground=ground,
    )  # fmt: skip
    save_table(table, path)
    return path.name


def code(part):
    return 0.2 + 0.04 * part


def parts_met(result):
    """Parts of a coded table that each recorded boulder uses, in order."""
    found = []
    for t, n, out in vertices_of(result, "in_t", "in_n", "out_n"):
        met = np.hypot(t, n) > 0
        part = (out[met] / np.hypot(t[met], n[met]) - code(0)) / (code(1) - code(0))
        assert np.allclose(part, np.rint(part), atol=1e-4)
        found.append(np.rint(part).astype(int))
    return found


def first_parts(result):
    """Column and row of the part that each boulder uses, which must be the same for all its
    contacts."""
    parts = parts_met(result)
    assert len(parts) == result.sizes["boulder"]
    assert all((one == one[0]).all() for one in parts)
    return np.divmod(np.array([one[0] for one in parts]), len(COLUMNS))[::-1]


def plane(slope=30.0, cell=2.5):
    z = 500 + np.tan(np.radians(slope)) * cell * np.mgrid[79:-1:-1, 0:40][0]
    return {"dem": z, "transform": grid(z, cell)}


def coded_case(folder, ground, boulders=4000, *, radius, boulder=(), **groups):
    """Case of boulders with a radius [m], which have some contacts by a coded table."""
    coded_table(folder / "coded.nc", ground)
    usual = {
        "case": {"boulders": boulders, "seed": 7},
        "impact": {"form": "table", "table": "coded.nc", "impact_limit": 2},
        "release": {"x": [50.0], "y": [180.0], "drop_height": 3.0},
        "output": {"trajectories": boulders},
    }
    groups = {name: usual.get(name, {}) | groups.get(name, {}) for name in {**usual, **groups}}
    usual = {"volume": "fixed", "volume_mean": volume_of(radius), "density": DENSITY}
    return rockfall.Case(folder=folder, boulder=usual | dict(boulder), **groups)


def near(count, n, p):
    """Return True if a count of n boulders agrees with probability p, within four standard
    errors."""
    return abs(count - n * p) <= 4 * np.sqrt(n * p * (1 - p)) + 1e-9


def weights(values, x):
    """Probability of each of `values` (increasing) by linear interpolation at x; beyond them, the
    outermost has probability 1."""
    x = np.clip(x, values[0], values[-1])
    return np.array([np.interp(x, values, row) for row in np.eye(len(values))])


# ---- part for a boulder


@pytest.mark.family(3)
@pytest.mark.parametrize("part", every_third([0.0, 0.2, 0.5, 0.9]))
@pytest.mark.parametrize("between", [0, 1])
def test_boulders_take_the_columns_beside_their_size_linearly_in_its_logarithm(
    tmp_path, between, part
):
    low, high = COLUMNS[between : between + 2]
    own = low * (high / low) ** part
    ground = YieldingGround(38.0, STRENGTH, relief=ROWS[0])
    result = rockfall.run(coded_case(tmp_path, ground, radius=radius_of(own)), **plane())
    columns, rows = first_parts(result)
    assert not rows.any() and set(columns) <= {between, between + 1}
    assert near((columns == between + 1).sum(), len(columns), part)


@pytest.mark.all
@pytest.mark.parametrize("relief", [3.0, 8.0, 9.0, 13.0, 19.0, 30.0])
def test_boulders_take_the_rows_beside_their_relief_linearly(tmp_path, relief):
    """The two rows next to the relief are used with probabilities by linear interpolation,
    independently of the columns."""
    own = np.sqrt(COLUMNS[0] * COLUMNS[1])
    ground = YieldingGround(38.0, STRENGTH, relief=relief)
    result = rockfall.run(coded_case(tmp_path, ground, radius=radius_of(own)), **plane())
    columns, rows = first_parts(result)
    for row, p in enumerate(weights(ROWS, relief)):
        assert near((rows == row).sum(), len(rows), p)
        for column in (0, 1):
            assert near(((rows == row) & (columns == column)).sum(), len(rows), p / 2)


@pytest.mark.parametrize("size", [0.0002, 0.09])
def test_boulders_beyond_all_columns_take_the_outermost(tmp_path, size):
    ground = YieldingGround(38.0, STRENGTH, relief=ROWS[0])
    case = coded_case(tmp_path, ground, 50, radius=radius_of(size))
    columns, _ = first_parts(rockfall.run(case, **plane()))
    assert (columns == (0 if size < COLUMNS[0] else 2)).all()


def test_ratios_of_rocks_are_interpolated_likewise(tmp_path):
    ratios = (2.0, 4.0, 8.0)
    case = coded_case(tmp_path, YieldingGround(38.0), radius=0.3,
                      surface={"uniform_mean_radius": 0.3 / 2 ** 1.75})  # fmt: skip
    coded_table(tmp_path / "coded.nc", YieldingGround(38.0), ratios, (0.0,))
    result = rockfall.run(case, **plane())
    assert result["ground_model"].values.tolist() == ["ratio_table"]
    columns, _ = first_parts(result)
    assert set(columns) == {0, 1} and near((columns == 1).sum(), len(columns), 0.75)


def test_strength_and_relief_go_with_the_size_as_the_ground_says(tmp_path):
    """With a strength proportional to R_b, every size uses the same columns. With a relief of
    exponent 0.6, the relief of a boulder four times as large is divided by 4^0.4."""
    ground = YieldingGround(
        38.0, STRENGTH, strength_radius=0.5, relief=18.0, relief_radius=0.5, hurst=0.6
    )
    own = DENSITY * G * 0.5 / STRENGTH
    expected = weights(np.log(COLUMNS), np.log(own))
    for radius in (0.125, 0.5, 2.0):
        columns, rows = first_parts(
            rockfall.run(coded_case(tmp_path, ground, 1500, radius=radius), **plane())
        )
        relief = 18.0 * (radius / 0.5) ** -0.4
        for k, (column, row) in enumerate(zip(expected, weights(ROWS, relief), strict=True)):
            assert near((columns == k).sum(), len(columns), column)
            assert near((rows == k).sum(), len(rows), row)


@pytest.mark.parametrize(("k", "m"), every_third([(3.0, 1.0), (1.0, 0.7), (5.0, 1.2)]))
def test_size_density_and_strength_are_one_axis(tmp_path, k, m):
    """Boulders use the same parts if R_b is multiplied by k, density by m and strength by k m."""
    found = []
    for k_, m_ in ((1.0, 1.0), (k, m)):
        ground = YieldingGround(38.0, k_ * m_ * STRENGTH, 0.6, relief=11.0)
        case = coded_case(tmp_path, ground, 400, radius=0.3 * k_, boulder={"density": m_ * DENSITY})
        found.append(first_parts(rockfall.run(case, **plane())))
    assert np.array_equal(*found)
    assert {*found[0][0]} == {0, 1, 2} and {*found[0][1]} == {0, 1}


def test_gravity_is_part_of_the_axis(tmp_path):
    ground = YieldingGround(38.0, STRENGTH, 0.6, relief=11.0)
    usual = coded_case(tmp_path, ground, 400, radius=0.6)
    moon = coded_case(tmp_path, ground, 400, radius=1.2, flight={"gravity": G / 2})
    found = [first_parts(rockfall.run(case, **plane())) for case in (usual, moon)]
    assert np.array_equal(*found)


# ---- strength between boulders


@pytest.mark.parametrize("sigma", every_third([0.3, 1.0]))
def test_strengths_are_lognormal(tmp_path, sigma):
    """Columns are used as often as by lognormal strengths. Each boulder uses one of the two columns
    next to its own strength."""
    own = COLUMNS[1]
    ground = YieldingGround(38.0, STRENGTH, sigma, relief=ROWS[0])
    result = rockfall.run(coded_case(tmp_path, ground, radius=radius_of(own)), **plane())
    columns, _ = first_parts(result)
    z = np.linspace(-8, 8, 20001)
    density = np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) * (z[1] - z[0])
    at_z = weights(np.log(COLUMNS), np.log(own) - sigma * z)
    for k, p in enumerate((at_z * density).sum(axis=1)):
        assert near((columns == k).sum(), len(columns), p), k
    of_boulder = weights(
        np.log(COLUMNS), np.log(own) - sigma * rockfall.ground_strength(result).values
    )
    assert (of_boulder[columns, np.arange(len(columns))] > 0).all()


def test_the_sigma_of_the_case_stands_in_for_those_of_all_grounds(tmp_path):
    def columns(of_ground, **boulder):
        ground = YieldingGround(38.0, STRENGTH, of_ground, relief=ROWS[0])
        case = coded_case(tmp_path, ground, 300, radius=radius_of(0.003), boulder=boulder)
        return first_parts(rockfall.run(case, **plane()))

    for sigma in (0.0, 0.8):
        told = columns(0.4, ground_strength_sigma=sigma)
        assert np.array_equal(told, columns(sigma))
        assert not np.array_equal(told, columns(0.4))


def test_the_strength_of_boulders_is_standard_normal(tmp_path):
    case = coded_case(tmp_path, YieldingGround(38.0, STRENGTH), 20_000, radius=0.4,
                      output={"trajectories": 0})  # fmt: skip
    result = rockfall.run(case, **plane())
    z = rockfall.ground_strength(result)
    n = z.size
    assert z.dims == ("boulder",) and z.attrs["units"] == "1" and np.isfinite(z).all()
    assert abs(float(z.mean())) < 4 / np.sqrt(n)
    assert abs(float(z.std()) - 1) < 4 / np.sqrt(2 * n)
    for at, p in ((-1.2815516, 0.1), (0.0, 0.5), (0.6744898, 0.75), (2.3263479, 0.99)):
        assert near(int((z < at).sum()), n, p)
    other = rockfall.ground_strength(rockfall.run(case.replace(case={"seed": 8}), **plane()))
    assert abs(np.corrcoef(z, other)[0, 1]) < 4 / np.sqrt(n)


def test_the_strength_of_a_boulder_is_that_of_its_number(tmp_path):
    """The strength of a boulder is the same however a run is divided, merged, written or selected
    from."""
    case = coded_case(tmp_path, YieldingGround(38.0, STRENGTH), 90, radius=0.4)
    whole = rockfall.run(case, **plane())
    z = rockfall.ground_strength(whole)
    parts = [rockfall.run(case, shard=(k, 3), **plane()) for k in (1, 2, 3)]
    own = np.concatenate([rockfall.ground_strength(part) for part in parts])
    assert np.array_equal(own, z)
    assert np.array_equal(rockfall.ground_strength(rockfall.merge(parts)), z)
    rockfall.write_result(whole, tmp_path / "out.nc")
    again = rockfall.ground_strength(rockfall.read_result(tmp_path / "out.nc"))
    assert np.array_equal(again, z)
    chosen = [80, 3, 41]
    assert np.array_equal(rockfall.ground_strength(whole.isel(boulder=chosen)), z[chosen])
    fewer = rockfall.run(case.replace(case={"boulders": 30}), **plane())
    assert np.array_equal(rockfall.ground_strength(fewer), z[:30])


def striped(folder, grounds, rows=7):
    """Zones in stripes from north to south, each with the next of `grounds`: keys of &surface, and
    the arrays."""
    names = "".join(f"{k},{name}\n" for k, name in enumerate(grounds, start=1))
    (folder / "zones.csv").write_text(f"zone,ground\n{names}")
    zones = np.arange(80)[:, None] // rows % len(grounds) + np.ones((1, 40), np.int64)
    surface = {"zones": "given", "table": "zones.csv"}
    return surface, plane() | {"zones": zones.astype("i4")}


def test_who_meets_strong_ground_does_so_on_all_grounds(tmp_path):
    ground = YieldingGround(38.0, STRENGTH, 0.7, relief=11.0)
    for name in "a.nc", "b.nc":
        coded_table(tmp_path / name, ground)
    surface, arrays = striped(tmp_path, ["a.nc", "b.nc"], rows=4)
    case = coded_case(tmp_path, ground, 300, radius=0.3, surface=surface,
                      impact={"impact_limit": 40})  # fmt: skip
    result = rockfall.run(case, **arrays)
    columns, rows = first_parts(result)  # the remaining boulders and parts
    assert {*columns} == {0, 1, 2} and {*rows} == {0, 1}
    assert (result["rebounds_by_ground"] > 200).all()


def test_fragments_meet_the_ground_of_their_boulder(tmp_path):
    """Fragments use the part of their boulder. Strength is proportional to R_b, so that size has no
    effect."""
    ground = YieldingGround(38.0, STRENGTH, 0.7, strength_radius=0.3, relief=11.0)
    case = coded_case(
        tmp_path, ground, 300, radius=1.0, impact={"impact_limit": 30},
        release={"drop_height": 25.0}, breakage={"at": "impact", "min_area_ratio": 0.3},
    )  # fmt: skip
    result = rockfall.run(case, **plane())
    broken = result["fragments"].values > 1
    assert broken.sum() > 50
    columns, rows = first_parts(result)
    whole = rockfall.run(case.replace(breakage={"at": "none", "min_area_ratio": None}), **plane())
    assert np.array_equal(first_parts(whole), (columns, rows))
    assert len({*zip(columns[broken], rows[broken], strict=True)}) > 3


# ---- damaged tables of users


SOUND = YieldingGround(38.0, STRENGTH, 0.5, 0.3, 11.0, 0.3, 0.8)
DAMAGES = {
    "strength": (-1.0, np.nan, np.inf),
    "strength_sigma": (-0.1, np.nan, np.inf),
    "strength_radius": (-1.0, np.nan, np.inf),
    "relief": (-1.0, np.nan, np.inf),
    "relief_radius": (0.0, np.nan, np.inf),
    "hurst": (-0.1, np.nan, np.inf),
    "rest_angle": (-1.0, np.nan),
}
AXES = {"columns": [(0.0, 0.1), (0.1, 0.1), (0.2, 0.1), (np.nan, 0.1), (0.1, np.inf)],
        "rows": [(9.0, 9.0), (9.0, 8.0), (9.0, np.nan), (9.0, np.inf)]}  # fmt: skip


@pytest.mark.all
@pytest.mark.parametrize(
    ("ground", "axes"),
    [
        *((SOUND._replace(**{key: value}), {}) for key in DAMAGES for value in DAMAGES[key]),
        *((SOUND, {key: values}) for key in AXES for values in AXES[key]),
    ],
)
def test_a_damaged_table_is_refused(tmp_path, ground, axes):
    case = coded_case(tmp_path, SOUND, 5, radius=0.3, surface={"uniform_mean_radius": 0.1})
    coded_table(tmp_path / "coded.nc", ground, **axes)
    with refused(f"{tmp_path}/coded.nc: is a damaged impact table"):
        rockfall.run(case, **plane())


def test_a_table_of_one_column_and_row_serves_all(tmp_path):
    case = coded_case(tmp_path, SOUND, 20, radius=0.3)
    coded_table(tmp_path / "coded.nc", SOUND, (0.01,), (0.0,))
    assert not np.concatenate(parts_met(rockfall.run(case, **plane()))).any()

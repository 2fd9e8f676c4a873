"""Tables: what is read is what was written, and what cannot be used is named."""

import numpy as np
import pytest
from scipy.io import savemat

from swsysid._tables.readers import read_table
from swsysid._tables.table import TableError
from swsysid._tables.units import rate_unit, unit_of

T = np.linspace(0.0, 1.0, 5)
V = np.array([1.5, -2.0, 3e-7, 4.0, 5e8])


@pytest.fixture
def written(tmp_path):
    def write(text, name="data.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_text(text, encoding=encoding)
        return path

    return write


def rows(delimiter=",", decimal="."):
    return "\n".join(
        f"{t!r}{delimiter}{v!r}".replace(".", decimal)
        for t, v in zip(T.tolist(), V.tolist(), strict=True)
    )


@pytest.mark.parametrize(
    "text",
    [
        "t,v\n" + rows(),
        "# t,v\n" + rows() + "\n# a comment\n\n",
        "\ufefft,v\r\n" + rows().replace("\n", "\r\n"),
        '"t", "v",\n' + rows().replace("\n", ",\n"),
        "t\tv\n" + rows("\t"),
        "t;v\n" + rows(";", ","),
    ],
    ids=["plain", "numpy", "windows", "quoted with trailing commas", "tabs", "decimal commas"],
)
def test_csv_dialects(written, text):
    table = read_table(written(text))
    np.testing.assert_array_equal(table.numbers(["t", "v"]), np.column_stack([T, V]))


def test_npz_and_mat_hold_the_same_columns(tmp_path):
    arrays = {"t": T, "X": np.column_stack([V, 2 * V]), "step": np.array(0.25)}
    np.savez(tmp_path / "data.npz", **arrays)
    savemat(tmp_path / "data.mat", arrays | {"row": T[None, :], "text": "hello"})
    expected = np.column_stack([T, V, 2 * V])
    for name in ("data.npz", "data.mat"):
        table = read_table(tmp_path / name)
        np.testing.assert_array_equal(table.numbers(["t", "X_0", "X_1"]), expected)
        assert "step" not in table.columns  # a constant is no recording
    np.testing.assert_array_equal(table.numbers(["row"])[:, 0], T)


def test_logical_missing_and_text_cells(written):
    table = read_table(written("on,gap,run\nTrue,1,a\nfalse,,b\n"))
    np.testing.assert_array_equal(table.numbers(["on"])[:, 0], [1.0, 0.0])
    np.testing.assert_array_equal(table.numbers(["gap"])[:, 0], [1.0, np.nan])
    assert table.labels("run").tolist() == ["a", "b"]
    with pytest.raises(TableError, match="'run' of data.csv is not numeric: row 2 holds 'a'"):
        table.numbers(["run"])


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("v_m_per_s", "m/s"),
        ("acc_forward_m_per_s2", "m/s^2"),
        ("T_box_degC", "degC"),
        ("force [N]", "N"),
        ("angle (rad)", "rad"),
        ("speed(m/s)", "m/s"),
        ("der(h) [m/s]", "m/s"),
        ("gain_N_per_V", "N/V"),
        ("heater_on", ""),
        ("m", ""),
        ("T_box", ""),
    ],
)
def test_units_are_read_from_names(name, unit):
    assert unit_of(name) == unit


def test_units_given_win_and_brackets_need_not_be_typed(written):
    table = read_table(written("force [N],x_m\n1,2\n3,4\n"), {"x_m": "mm"})
    assert (table.unit("x_m"), table.unit(table.resolve("force"))) == ("mm", "N")
    assert table.numbers(["force"])[:, 0].tolist() == [1.0, 3.0]


def test_a_name_without_its_unit_comes_before_fields_of_structs(written):
    table = read_table(written("x [m],a.x,b.x,c.y\n1,2,3,4\n5,6,7,8"))
    assert table.resolve("x") == "x [m]" and table.resolve("y") == "c.y"
    assert table.find("z") is None


def test_a_title_leaves_the_unit_out_unless_two_columns_share_it(written):
    table = read_table(written("x [m],v [m/s],v [ft/s]\n1,2,3\n"))
    assert [table.title(name) for name in ("x", "x [m]")] == ["x", "x"]
    assert len({table.title(name) for name in ("v [m/s]", "v [ft/s]")}) == 2


def test_derivatives_of_modelica_tools_keep_their_names(written):
    table = read_table(written("time,h,der(h),der(body.v)\n0,1,2,3\n"))
    assert [table.title(name) for name in ("der(h)", "der(body.v)")] == ["der(h)", "der(body.v)"]
    assert [table.unit(name) for name in ("der(h)", "der(body.v)")] == ["", ""]


def test_rate_units():
    assert [rate_unit(u, "s") for u in ("m", "m/s", "m/s^2", "N", "")] == [
        "m/s",
        "m/s^2",
        "m/s^3",
        "N/s",
        "",
    ]
    assert rate_unit("m", "") == ""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no row below its header"),
        ("a,b\n", "no row below its header"),
        ("1,2\n3,4\n", "its first row holds numbers"),
        ("a,a\n1,2\n", "two columns are called 'a'"),
        ("a,b\n1,2,3\n", "row 2 has 3 cells and its header 2"),
    ],
)
def test_unreadable_csv_gets_a_sentence(written, text, sentence):
    with pytest.raises(TableError, match=sentence):
        read_table(written(text))


def test_wrong_files_and_columns_get_a_sentence(written, tmp_path):
    with pytest.raises(TableError, match="There is no file"):
        read_table(tmp_path / "absent.csv")
    with pytest.raises(TableError, match="save the recording as one of these"):
        read_table(written("x", "data.xls"))
    for name in ("broken.npz", "broken.mat"):
        with pytest.raises(TableError, match=f"{name} cannot be read"):
            read_table(written("not an archive, but long enough to look like one" * 9, name))
    table = read_table(written("speed,time\n1,2\n"))
    with pytest.raises(TableError, match=r"'sped'. Did you mean 'speed'\? Its columns are: speed"):
        table.numbers(["sped"])
    with pytest.raises(TableError, match="no column 'volts'"):
        read_table(written("speed,time\n1,2\n"), {"volts": "V"})
    np.savez(tmp_path / "uneven.npz", a=T, b=T[:-1])
    with pytest.raises(TableError, match="a has 5, b has 4 rows"):
        read_table(tmp_path / "uneven.npz").numbers(["a", "b"])

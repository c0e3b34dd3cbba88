"""Files of matrices: each format there and back, and what is none refused."""

import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite, savemat
from scipy.linalg import eigh

from hbm.errors import InputError
from hbm.rigfiles.load import load_rig
from hbm.rigfiles.matrices import read_abaqus, read_matrix

K = sparse.csr_array(np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]))


def test_every_format_gives_the_same_matrix(tmp_path: Path) -> None:
    sparse.save_npz(tmp_path / "sparse.npz", K)
    np.savez(tmp_path / "named.npz", K=K.toarray(), M=np.eye(3))
    np.save(tmp_path / "K.npy", K.toarray())
    mmwrite(tmp_path / "K.mtx", K)
    savemat(tmp_path / "model.mat", {"K": sparse.csc_array(K), "M": np.eye(3)})
    for name, key in (("sparse.npz", None), ("named.npz", "K"), ("K.npy", None), ("K.mtx", None), ("model.mat", "K")):
        assert np.array_equal(read_matrix(tmp_path / name, key).toarray(), K.toarray()), name
    with pytest.raises(InputError, match="no key; must be one of K, M"):
        read_matrix(tmp_path / "named.npz")
    with pytest.raises(InputError, match="must end in"):
        read_matrix(tmp_path / "K.txt")
    with pytest.raises(InputError, match=r'K.npy: key = "K"; must be absent, a .npy file has one matrix'):
        read_matrix(tmp_path / "K.npy", "K")
    np.save(tmp_path / "code.npy", np.array([print]), allow_pickle=True)
    with pytest.raises(InputError, match=r"cannot be read \(.*\); must be .npy of numpy.save"):
        read_matrix(tmp_path / "code.npy")
    with pytest.raises(InputError, match="cannot be read"):
        read_matrix(tmp_path / "none.npz")


def test_either_half_and_complex_numbers_that_are_real_are_taken(tmp_path: Path) -> None:
    """Programs write one half of what is symmetric, and whatever they calculated in complex numbers as such."""
    dense = K.toarray()
    struct = {"model": {"K": sparse.csc_array(K), "parts": {"K": np.tril(dense)}, "name": "bar"}}
    savemat(tmp_path / "model.mat", struct)
    sparse.save_npz(tmp_path / "half.npz", sparse.csr_array(np.triu(dense)))
    mmwrite(tmp_path / "half.mtx", sparse.coo_array(np.tril(dense)), symmetry="general")
    sparse.save_npz(tmp_path / "complex.npz", K.astype(complex))
    np.savez(tmp_path / "named.npz", K=dense.astype(complex), lossy=(1 + 0.02j) * dense, one_way=np.triu(dense)[:2])
    files = ["half.npz", "half.mtx", "complex.npz", "named.npz:K", "model.mat:model.K", "model.mat:model.parts.K"]
    for name, _, key in (file.partition(":") for file in files):
        assert np.array_equal(read_matrix(tmp_path / name, key or None).toarray(), dense), name
    assert np.array_equal(read_matrix(tmp_path / "named.npz", "one_way").toarray(), np.triu(dense)[:2])
    with pytest.raises(InputError, match=r"lossy is complex, 3 x 3 .* real numbers; losses of a material are damping"):
        read_matrix(tmp_path / "named.npz", "lossy")
    with pytest.raises(InputError, match=r"must be one of model\.K, model\.name, model\.parts\.K"):
        read_matrix(tmp_path / "model.mat", "model")


def test_a_matrix_cannot_reach_beyond_its_size(tmp_path: Path) -> None:
    """Libraries trust the indices of a sparse file, and read memory that is not theirs."""
    sparse.save_npz(tmp_path / "K.npz", K)
    with np.load(tmp_path / "K.npz") as file:
        parts = dict(file)
    np.savez(tmp_path / "K.npz", **{**parts, "indices": parts["indices"] + 1000})
    with pytest.raises(InputError, match="has indices beyond its size"):
        read_matrix(tmp_path / "K.npz")
    (tmp_path / "K.mtx").write_text("%%MatrixMarket matrix coordinate real general\n999999999 999999999 1\n1 1 1.0\n")
    with pytest.raises(InputError, match="has 999999999 rows or columns; must have 10000000 at most"):
        read_matrix(tmp_path / "K.mtx")


def test_readers_of_libraries_that_end_the_process_are_not_reached(tmp_path: Path) -> None:
    """SciPy ends the process at NUL or a cut number in Matrix Market files, and at broken sparse parts of MAT files."""
    mmwrite(tmp_path / "K.mtx", sparse.coo_array(K))
    text = (tmp_path / "K.mtx").read_bytes()
    for damaged in (text[:80] + bytes(8) + text[88:], text.rstrip() + b"e", text.rstrip() + b"e+"):
        (tmp_path / "K.mtx").write_bytes(damaged)
        with pytest.raises(InputError, match=r"cannot be read \(.*\); must be Matrix Market"):
            read_matrix(tmp_path / "K.mtx")
    for packed in (False, True):
        savemat(tmp_path / "whole.mat", {"K": sparse.csc_array(K), "s": {"a": 1.0, "b": "x"}}, do_compression=packed)
        assert np.array_equal(read_matrix(tmp_path / "whole.mat", "K").toarray(), K.toarray())
    savemat(tmp_path / "K.mat", {"K": sparse.csc_array(K)})
    content = (tmp_path / "K.mat").read_bytes()
    for at in range(128, len(content) - 8, 8):
        (tmp_path / "K.mat").write_bytes(content[:at] + bytes(200) + content[at + 200 :])
        with suppress(InputError):
            read_matrix(tmp_path / "K.mat")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_what_may_have_no_end_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "K.npz")
    for path in (tmp_path / "K.npz", Path("/dev/zero")):
        with pytest.raises(InputError, match=f"{path}: is a pipe or a device; must be a file"):
            read_abaqus(path)
    with pytest.raises(InputError, match="is a pipe or a device"):
        read_matrix(tmp_path / "K.npz")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1,1, 1,1, 1e400", "has 1 entries that are nan or infinite; must be finite"),
        ("", "has no line of numbers"),
        ("1,1, 1,1, nan", "has 1 entries that are nan or infinite; must be finite"),
        ("99999999999999999999,1, 1,1, 1.0", 'line 1: "99999999999999999999,1, 1,1, 1.0"; must be lines of row node'),
    ],
)
def test_numbers_that_are_none_are_refused_in_the_text_of_abaqus(line: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "K.mtx").write_text(line + "\n")
    with pytest.raises(InputError, match=said):
        read_abaqus(tmp_path / "K.mtx")


@pytest.mark.parametrize("half", ["upper", "lower", "whole"])
def test_the_text_of_abaqus_is_read_with_its_names(tmp_path: Path, half: str) -> None:
    coo = K.tocoo()
    kept = [
        (i, j, v)
        for i, j, v in zip(*coo.coords, coo.data, strict=True)
        if half == "whole" or (i <= j if half == "upper" else i >= j)
    ]
    node = {0: "1,2", 1: "1,6", 2: "7,1"}
    path = tmp_path / "job_STIF1.mtx"
    path.write_text("".join(f"{node[i]}, {node[j]}, {v:.16e}\n" for i, j, v in kept))
    matrix, names = read_abaqus(path)
    assert names == ("1.y", "1.rz", "7.x")
    assert np.array_equal(matrix.toarray(), K.toarray())
    path.write_text("1,2, 1,2\n")
    with pytest.raises(InputError, match="line 1"):
        read_abaqus(path)


def test_a_rig_file_names_matrices_and_supports(tmp_path: Path) -> None:
    sparse.save_npz(tmp_path / "K.npz", K)
    sparse.save_npz(tmp_path / "M.npz", sparse.csr_array(np.eye(3)))
    (tmp_path / "dofs.txt").write_text("1.x 2.x 3.x\n")
    text = """
name = "Chain"
[matrix]
mass = "M.npz"
stiffness = "K.npz"
dofs = "dofs.txt"
fixed = ["1"]
modes = 2
[damping]
modal_ratios = [0.02]
[[joints]]
name = "rub"
law = "coulomb-penalty"
mu = 0.3
critical_slip = 0.1
normal_load = 0.5
at = "2.x"
to = "3.x"
[excitation]
amplitude = 1.0
at = "3.x"
[[channels]]
name = "a"
quantity = "acceleration"
at = "2.x"
"""
    path = tmp_path / "rig.toml"
    path.write_text(text)
    rig = load_rig(path)
    free = np.linalg.eigvalsh(K.toarray()[1:, 1:])
    assert rig.structure.omega_n**2 == pytest.approx(free, rel=1e-10)
    assert np.abs(rig.structure.joints[0] @ (rig.structure.omega_n**-2.0 * rig.structure.excitation)) == pytest.approx(
        1.0
    )
    path.write_text(text.replace("modes = 2\n", ""))  # of 20 by default there are no more than two
    assert load_rig(path).structure.omega_n ** 2 == pytest.approx(free, rel=1e-10)
    held = text.replace("modes = 2\n", 'reduction = "craig-bampton"\n')
    path.write_text(held.replace('at = "2.x"\nto = "3.x"', 'at = "3.x"').replace('at = "2.x"', 'at = "3.x"'))
    assert load_rig(path).body.modes == 1  # of the mass that is no place
    path.write_text(held)
    with pytest.raises(InputError, match=r'matrix\.reduction = "craig-bampton"; must be "modes", or have fewer places'):
        load_rig(path)
    path.write_text(text)
    for names in ("\ufeff1.x\r\n2.x\r\n3.x\r\n", "1.x 2.x\n3.x\n"):
        (tmp_path / "dofs.txt").write_text(names, encoding="utf-8")
        assert load_rig(path).body.dofs == ("1.x", "2.x", "3.x")
    (tmp_path / "two.txt").write_text("end A\nend B\n")
    np.save(tmp_path / "vector.npy", np.ones(3))
    (tmp_path / "K.txt").write_bytes((tmp_path / "K.npz").read_bytes())
    off = K.toarray()
    off[0, 1] -= 0.5
    wrong_files = {"wrong_K": off, "wrong_M": np.diag([1.0, -1.0, 1.0]), "nan": np.diag([1.0, np.nan, 1.0])}
    wrong_files |= {"two": np.eye(2), "below": K.toarray() - 3.0 * np.eye(3), "huge": 1e40 * K.toarray()}
    wrong_files |= {"nothing": np.diag([1.0, 1.0, 0.0])}
    for name, entries in wrong_files.items():
        sparse.save_npz(tmp_path / f"{name}.npz", sparse.csr_array(entries))
    (tmp_path / "wrong_dofs.txt").write_text("1.x 2.x 1.x\n")
    for wrong, said in (
        (
            text.replace("dofs.txt", "two.txt"),
            'two.txt": has 4 names; must have 3, one per row of the matrices, separated by blanks or line ends',
        ),
        (
            text.replace('"K.npz"', '"K.txt"'),
            "K.txt: is no text; must end in .npz, .npy, .mtx, .mat, or have lines of row node",
        ),
        (text.replace('"K.npz"', '"vector.npy"'), 'stiffness = "vector.npy": is 3 x 1; must be square'),
        (
            text.replace("modes = 2", 'modes = 2\ndamping = "M.npz"'),
            "damping and matrix.damping are both present; must have one of them",
        ),
        *(
            (text.replace(f'"{file}"', f'"wrong_{file}"'), f'{key} = "wrong_{file}": {found}')
            for key, file, found in (
                ("matrix.stiffness", "K.npz", r"differs from its transpose by 0.5 at 2.x, 1.x; must be symmetric"),
                ("matrix.mass", "M.npz", r"is -1 on its diagonal at 2.x; must be > 0, or nothing in that row"),
                ("matrix.dofs", "dofs.txt", 'has "1.x" twice; names must differ'),
            )
        ),
        (text.replace('"M.npz"', '"nan.npz"'), 'mass = "nan.npz": has 1 entries that are nan or infinite; must be'),
        (text.replace('"K.npz"', '"two.npz"'), 'stiffness = "two.npz": is 2 x 2; must be 3 x 3, as the mass is'),
        (text.replace('"K.npz"', '"below.npz"'), 'stiffness = "below.npz": is indefinite; must have no negative'),
        (text.replace('"K.npz"', '"huge.npz"'), r'"huge.npz": its largest entry = 2e\+40; must be of magnitude'),
        (
            text.replace('"K.npz"', '"nothing.npz"').replace('"M.npz"', '"nothing.npz"'),
            r"matrix\.fixed lacks 3\.x, where stiffness and mass have nothing; must hold what nothing else does",
        ),
        (text.replace("modes = 2", "modes = 3"), "rig.toml: matrix.modes = 3; must be <= 2, the degrees of freedom"),
        (text.replace('["1"]', '["9"]'), 'rig.toml: matrix.fixed has "9"; must be of dofs, 1.x, 2.x, 3.x'),
        (
            text.replace('at = "2.x"\nto', 'at = "9.x"\nto'),
            'rig.toml: Chain: joint rub: at = "9.x"; must be of dofs, 1.x, 2.x, 3.x',
        ),
        (
            text.replace('"acceleration"\nat = "2.x"', '"acceleration"\nat = "9.x"'),
            r'rig.toml: Chain: channels\[1\].at = "9.x"; must be of dofs, 1.x, 2.x, 3.x',
        ),
        (text.replace('law = "coulomb-penalty"', 'law = "glue"'), "joints\\[1\\].law"),
        (text.replace("mu = 0.3", "mu = -0.3"), "joints\\[1\\].mu = -0.3; must be > 0"),
        (text.replace("mu = 0.3", "nu = 0.3"), "joints\\[1\\].*is missing|nu"),
        (text.replace('at = "3.x"\n[[', "position = 0.3\n[["), "excitation.at is missing"),
        (text.replace('"K.npz"', '"none.npz"'), "cannot be read"),
    ):
        path.write_text(wrong)
        with pytest.raises(InputError, match=said):
            load_rig(path)


def test_lumped_masses_and_a_direction_held_at_every_node(tmp_path: Path) -> None:
    """A frame of two nodes in a plane: the matrix of its masses, and what of it is free, solved by themselves."""
    rng, masses = np.random.default_rng(3), np.array([1.0, 1.0, 0.2, 3.0, 3.0, 0.4])
    root = rng.normal(size=(6, 6))
    stiffness = root @ root.T + np.eye(6)
    np.save(tmp_path / "K.npy", stiffness)
    np.save(tmp_path / "M.npy", masses)
    savemat(tmp_path / "M.mat", {"m": masses})  # a row, as MATLAB has it
    mmwrite(tmp_path / "M.mtx", masses[:, None])
    (tmp_path / "dofs.txt").write_text("1.x 1.y 1.rz 2.x 2.y 2.rz")
    text = """
name = "frame"
[matrix]
mass = "MASS"
stiffness = "K.npy"
dofs = "dofs.txt"
fixed = ["*.rz", "1.y"]
[damping]
modal_ratios = [0.02]
[excitation]
amplitude = 1.0
at = "2.x"
"""
    free = [0, 3, 4]
    squares = eigh(stiffness[np.ix_(free, free)], np.diag(masses[free]), eigvals_only=True)
    for mass in ("M.npy", "M.mat", "M.mtx"):
        (tmp_path / "rig.toml").write_text(text.replace("MASS", mass))
        rig = load_rig(tmp_path / "rig.toml")
        assert rig.body.fixed == ("1.rz", "2.rz", "1.y")
        assert rig.structure.omega_n**2 == pytest.approx(squares, rel=1e-10)
    (tmp_path / "rig.toml").write_text(text.replace("MASS", "M.npy").replace("*.rz", "*.ry"))
    with pytest.raises(InputError, match=r'matrix.fixed has "\*\.ry"; must be of dofs'):
        load_rig(tmp_path / "rig.toml")

"""What a file is that is no trajectory, told from its first bytes: one line that says it, and what to give or write
instead."""

from __future__ import annotations

import re

# Commands that begin the lines of LAMMPS input scripts and of hardly anything else.
_COMMANDS = frozenset(
    b"units dimension boundary atom_style atom_modify newton pair_style pair_coeff pair_modify bond_style bond_coeff "
    b"angle_style angle_coeff "
    b"dihedral_style dihedral_coeff improper_style improper_coeff special_bonds kspace_style kspace_modify read_data "
    b"read_restart read_dump "
    b"create_box create_atoms lattice region group mass set velocity fix unfix compute uncompute fix_modify "
    b"compute_modify neighbor neigh_modify "
    b"timestep reset_timestep run minimize min_style min_modify thermo thermo_style thermo_modify dump undump "
    b"dump_modify restart write_data "
    b"write_restart variable include jump label next if print shell log echo clear package suffix processors "
    b"comm_modify comm_style "
    b"displace_atoms delete_atoms delete_bonds change_box replicate rerun run_style partition quit molecule labelmap "
    b"balance info".split()
)
_WORDS_OF_ENGLISH = frozenset(
    b"if next set run mass group print include region info label log fix dump compute restart timestep units".split()
)
_DUMP_INSTEAD = "dump the atoms of the run (dump custom: id type x y z vx vy vz)"
_PICTURE = f"a picture, as dump image writes it: {_DUMP_INSTEAD}"
_PICKLE = "a pickle of Python, which is not opened because that could run anything: write the frames as extended XYZ"
_ARCHIVE = "an archive: unpack it and give the trajectory in it"
_PICTURES = (b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"P6\n", b"P6 ", b"P3\n", b"II*\0", b"MM\0*")

_MAGICS = (
    (
        b"LammpS RestartT",
        "a LAMMPS restart file, which only LAMMPS reads: make a data file of it (lmp -restart2data FILE run.data), or "
        "dump the run",
    ),
    *(
        (magic, _PICTURE)
        for magic in (b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"P6\n", b"P6 ", b"P3\n", b"II*\0", b"MM\0*")
    ),
    (b"%PDF-", "a PDF document: give the trajectory"),
    (b"%!PS", "a PostScript picture: give the trajectory"),
    (b"7z\xbc\xaf'\x1c", _ARCHIVE),
    (b"Rar!\x1a\x07", _ARCHIVE),
    (
        b"\x93NUMPY",
        "a NumPy array, which says neither what its numbers are nor their cell: give the trajectory, or atc.read "
        "frames made in Python",
    ),
    (b"\x7fELF", "a program: give the trajectory"),
    (b"MZ\x90", "a program: give the trajectory"),
    *((bytes([0x80, version]), _PICKLE) for version in (2, 3, 4, 5)),
)

_TEXTS = (
    (
        rb"(?i)\A\s*<(!doctype html|html|head|body)\b",
        "a web page (HTML), no trajectory: a download that failed often leaves one",
    ),
    (
        rb"\A\s*(<\?xml[^>]*>\s*)?<VTKFile|\A# vtk DataFile",
        "a VTK file, made for pictures (dump vtk, or atc export): give the trajectory itself",
    ),
    (
        rb"\ALAMMPS \(\d|^(Per MPI rank memory allocation|Loop time of \S+ on \d+ procs)",
        "the log of a LAMMPS run, which holds thermo output but no atoms: give the dump as the trajectory (a log goes "
        "beside it: [trajectory] log)",
    ),
    (
        rb"\A---\s*\nkeywords:",
        "thermo output of LAMMPS in YAML, which holds no atoms: give the dump as the trajectory (this goes beside it: "
        "[trajectory] log)",
    ),
    (
        rb"\A(ITEM:[^\n]*\n[^I\n][^\n]*\n|ITEM: BOX BOUNDS[^\n]*\n([^I\n][^\n]*\n){3})*ITEM: (GRID|DIMENSION)",
        f"grid data of LAMMPS (dump grid), not atoms: {_DUMP_INSTEAD}; atc compare OUT FILE and atc.read_grid read it",
    ),
    (
        rb"\A(ITEM:[^\n]*\n[^I\n][^\n]*\n)*ITEM: NUMBER OF (?!ATOMS)",
        f"a dump of something else than atoms (dump local: bonds, pairs, neighbours): {_DUMP_INSTEAD}",
    ),
    (
        rb"\A#[^\n]*\n#[^\n]*\n# Chunk ",
        f"averages over chunks of a run (fix ave/chunk), not atoms: {_DUMP_INSTEAD}; atc compare OUT FILE and "
        "atc.read_grid read it",
    ),
    (
        rb"\A# ?(Time|Chunk|Spatial|Histogrammed|Grid|Space-time|Time-correlated)-?[a-z]* ?data for fix|\A# Timestep "
        rb"\d+\s*\n#\s*\n# Number of particles",
        f"the output of a fix of LAMMPS (averages, correlations, bond lists), not a trajectory: {_DUMP_INSTEAD}",
    ),
    (
        rb"(?m)\A(\s*#[^\n]*\n|\s*\n)*\[(trajectory|kernel|grid|fields|potential|output|twin|check)\]\s*$",
        "a scene of atc, not a trajectory: atc plan FILE says what it would compute",
    ),
    (
        rb"(?m)\A(\s*#[^\n]*\n|\s*\n)*\[(body|material|nodes|run|load|initial|boundary|case|crack)\]\s*$",
        "a case of atc pd, not a trajectory: run it with atc pd FILE",
    ),
    (
        rb"\A#?[^\n]*\b(DATE: *\d{4}-\d\d|UNITS: *(metal|real|lj)|CONTRIBUTOR:)",
        "a potential file of LAMMPS, not a trajectory: name it in a pair_coeff line under [potential]",
    ),
)
# Ends of names of LAMMPS's potential files; asked only where nothing else knew the file.
_POTENTIALS = frozenset(
    ".eam .alloy .fs .adp .meam .tersoff .modc .zbl .sw .vashishta .edip .airebo .rebo .bop .reax .comb .comb3 "
    ".snapcoeff .snapparam .mliap .table "
    ".poly .spline .agni .eim .gw .nb3b .pod .ace .yace .extep .lcbop .he".split()
)


def not_a_trajectory(head: bytes) -> str | None:
    """What a file is (with what to do instead) if its first bytes show that it holds no trajectory; None if they do
    not.

    `head`: the first kilobytes, decompressed.
    """
    for magic, what in _MAGICS:
        if head.startswith(magic):
            return what
    if head.startswith(b"PK\x03\x04"):
        if b".npy" in head[:200]:
            return (
                "a NumPy archive (.npz), which does not say what its numbers are: give the trajectory, or atc.read "
                "frames made in Python"
            )
        return _ARCHIVE
    if head[257:262] == b"ustar":
        return _ARCHIVE
    if head.startswith(b"BM") and len(head) > 30 and head[6:10] == b"\0\0\0\0":
        return _PICTURE
    if head[4:8] == b"ftyp" or head.startswith(b"\x1aE\xdf\xa3"):
        return f"a film, as dump movie writes it: {_DUMP_INSTEAD}"
    if b"\0" in head:
        return None
    text = head.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n")
    for pattern, what in _TEXTS:
        if re.search(pattern, text):
            return what
    if _is_script(text):
        return (
            "a LAMMPS input script, not a trajectory: give the dump it writes; the script itself goes under "
            "[potential] as input"
        )
    if _is_molecule(text):
        return "a molecule template of LAMMPS, which has no box: give a dump or a data file"
    return None


def by_its_name(name: str) -> str | None:
    """What a text file is by the end of its name, to be asked when nothing else knew it."""
    if any(name.lower().endswith(end) for end in _POTENTIALS):
        return "a potential file by its name, not a trajectory: name it in a pair_coeff line under [potential]"
    return None


def _is_script(text: bytes) -> bool:
    """Whether most lines begin with commands of LAMMPS, at least two of them with words that nothing else begins
    with."""
    lines = [line.split() for line in re.sub(rb"&[ \t]*\n", b" ", text).split(b"\n")[:400]]
    lines = [words for words in lines if words and not words[0].startswith((b"#", b'"""'))]
    if len(lines) > 3 and len(text) >= 1 << 14:
        lines = lines[:-1]  # cut off
    known = [words[0] for words in lines if words[0] in _COMMANDS and len(words) > 1]
    sure = [word for word in known if word not in _WORDS_OF_ENGLISH]
    return len(known) >= 2 and len(known) >= 0.5 * len(lines) and (len(sure) >= 1 or len(known) >= 4)


def _is_molecule(text: bytes) -> bool:
    return bool(
        re.search(rb"(?m)^\s*\d+\s+atoms\b", text)
        and re.search(rb"(?m)^\s*(Coords|Types|Special Bond Counts|Shake Flags)\s*(#.*)?$", text)
        and not re.search(rb"\b[xyz]lo [xyz]hi\b|^\s*Atoms\b", text)
    )


def shown(head: bytes, limit: int = 40) -> str:
    """The beginning of a file for a message, in quotes; bytes that are no text as question marks."""
    line = head[: 4 * limit].split(b"\n")[0].decode("utf-8", "replace").strip()
    line = "".join(c if c.isprintable() and c != "\ufffd" else "?" for c in line)
    return repr(line[:limit] + ("…" if len(line) > limit else ""))


def is_text(head: bytes) -> bool:
    """Whether bytes look like text: no zeros, few control characters."""
    return b"\0" not in head and sum(c < 9 or 13 < c < 32 for c in head) <= len(head) // 100

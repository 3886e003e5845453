"""An effect file runs where nobody else can have written it: its whole way from the root is looked at."""

from __future__ import annotations

import os
import stat
from types import SimpleNamespace

import pytest

from flashtemp.errors import BadInput
from flashtemp.model.case import load_case
from flashtemp.model.trust import find_refusal
from flashtemp.physics import permissions
from flashtemp.runs import job

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="this system does not tell whose a file is")
FAN = '''
from pathlib import Path

from flashtemp.physics import Effect, Factor, Param

Path(__file__).with_name("ran").touch()


class Fan(Effect):
    """Friction falls."""

    cause = "a fan blows"
    source = "this test"
    share = Param(0.1, "1", "less friction", -0.5, 1.0, off=0.0)

    def heat(self, scene, p):
        """Multiplies mu."""
        yield Factor("friction.mu", lambda T, now, p: 1.0 - p.share)
'''
CASE = """effects = ["a/b/fan.py"]
[schedule]
distance = 0.02
[numerics]
cells = [10, 8, 8]
[output]
pictures = false
vtk = false
"""
STRANGER = 54321


@pytest.fixture
def tree(tmp_path):
    """top/case with an effect file in a/b; all of it the user's own."""
    case = tmp_path / "top" / "case"
    (case / "a" / "b").mkdir(parents=True)
    for folder in (tmp_path / "top", case, case / "a", case / "a" / "b"):
        folder.chmod(0o755)
    (case / "a" / "b" / "fan.py").write_text(FAN)
    (case / "case.toml").write_text(CASE)
    for file in ("a/b/fan.py", "case.toml"):
        (case / file).chmod(0o644)
    return case


@pytest.fixture
def owned(monkeypatch):
    """{path: number of the user that it shall belong to}, for who may not give files away."""
    owners, states = {}, permissions.list_path_parts

    def list_as_owned(path):
        for part, state in states(path):
            yield part, os.stat_result((*state[:4], owners.get(part, state.st_uid), *state[5:]))

    monkeypatch.setattr(permissions, "list_path_parts", list_as_owned)
    return owners


def why(case, file="a/b/fan.py"):
    return find_refusal(case / "case.toml", case, case / file)


PARTS = ("..", ".", "a", "a/b", "a/b/fan.py", "case.toml")


def test_what_is_the_users_own_runs(tree):
    assert why(tree) is None
    load_case(tree)
    assert (tree / "a" / "b" / "ran").exists()


@pytest.mark.parametrize("part", PARTS)
def test_another_owner_anywhere_on_the_way_is_refused(tree, owned, part):
    path = (tree / part).resolve()
    owned[path] = STRANGER
    assert f"{path} belongs to another user" in why(tree)
    with pytest.raises(BadInput, match=r"belongs to another user; read that file; then add --trust"):
        load_case(tree)
    assert not (tree / "a" / "b" / "ran").exists()
    load_case(tree, trust=True)


@pytest.mark.parametrize("above", [1, 2, 3])
def test_another_owner_far_above_is_refused_and_root_is_not(tree, owned, above):
    path = tree.parents[above]
    owned[path] = STRANGER
    assert f"{path} belongs to another user" in why(tree)
    owned[path] = permissions.ROOT_USER
    assert why(tree) is None


@pytest.mark.parametrize("part", PARTS)
def test_what_everybody_may_write_is_refused(tree, part):
    path = (tree / part).resolve()
    path.chmod(path.stat().st_mode | stat.S_IWOTH)
    assert f"everybody may write {path}" in why(tree)


@pytest.mark.parametrize("part", PARTS)
def test_what_others_of_a_group_may_write_is_refused(tree, part, monkeypatch):
    """Unless the group is the user's alone, as where every user has one and the umask is 002."""
    path = (tree / part).resolve()
    path.chmod(path.stat().st_mode | stat.S_IWGRP)
    monkeypatch.setattr(permissions, "is_private_group", lambda group, user: False)
    assert f"other users of its group may write {path}" in why(tree)
    monkeypatch.setattr(permissions, "is_private_group", lambda group, user: True)
    assert why(tree) is None
    monkeypatch.setattr(permissions, "_has_access_list", lambda part: part == path)  # then these bits are the list's
    assert f"other users of its group may write {path}" in why(tree)


MEMBERS = {  # name of the group, listed members, other users whose first group it is -> whether it is ann's alone
    "her own": ("ann", [], [], True),
    "her own, listed": ("ann", ["ann"], [], True),
    "with a guest": ("ann", ["bob"], [], False),
    "first group of another": ("ann", [], ["bob"], False),
    "of a project": ("rubber", ["ann"], [], False),
    "of everybody": ("users", [], ["bob", "eve"], False),
}


@pytest.mark.parametrize("name", MEMBERS)
def test_a_group_is_private_that_has_the_users_name_and_nobody_else(name, monkeypatch):
    import grp
    import pwd

    group, listed, others, alone = MEMBERS[name]
    users = [SimpleNamespace(pw_name=n, pw_gid=7) for n in ("ann", *others)]
    monkeypatch.setattr(grp, "getgrgid", lambda number: SimpleNamespace(gr_name=group, gr_mem=listed))
    monkeypatch.setattr(pwd, "getpwuid", lambda number: users[0])
    monkeypatch.setattr(pwd, "getpwall", lambda: users)
    assert permissions.is_private_group.__wrapped__(7, 1000) is alone


def test_a_group_or_user_without_a_name_is_not_private():
    assert not permissions.is_private_group.__wrapped__(2**31 - 7, os.geteuid())
    assert not permissions.is_private_group.__wrapped__(os.getegid(), 2**31 - 7)


def test_a_sticky_folder_may_lie_above_the_case_only(tree):
    """As /tmp: there nobody can replace what is another's, but everybody can add to it."""
    tree.parent.chmod(0o1777)
    assert why(tree) is None
    tree.parent.chmod(0o777)
    assert "everybody may write" in why(tree)
    tree.parent.chmod(0o755)
    for part in (".", "a", "a/b"):
        path = (tree / part).resolve()
        path.chmod(0o1777)
        assert f"everybody may write {path}" in why(tree)
        path.chmod(0o755)


def test_links_are_followed_and_are_the_users_or_roots_too(tree, tmp_path, owned):
    """The folders that hold them count as well: who can put another link there chooses what runs."""
    place = tmp_path / "place"
    place.mkdir(mode=0o755)
    (place / "case").symlink_to(tree)
    assert why(place / "case") is None
    owned[place / "case"] = STRANGER
    assert f"{place / 'case'} belongs to another user" in why(place / "case")
    owned.clear()
    place.chmod(0o777)
    assert f"everybody may write {place}" in why(place / "case")
    place.chmod(0o755)
    (place / "round").symlink_to("round")
    with pytest.raises(OSError, match="symbolic links"):
        list(permissions.list_path_parts(place / "round"))
    (tree / "c").symlink_to("a/../a/b")
    assert why(tree, "c/fan.py") is None
    (tree / "a").chmod(0o777)
    assert "everybody may write" in why(tree, "c/fan.py")


def test_a_case_file_that_is_a_link_is_looked_at_where_it_stands(tree, tmp_path):
    far = tmp_path / "far"
    far.mkdir(mode=0o755)
    (tree / "case.toml").rename(far / "case.toml")
    (tree / "case.toml").symlink_to(far / "case.toml")
    assert why(tree) is None
    far.chmod(0o777)
    assert f"everybody may write {far}" in why(tree)


def test_the_way_leads_through_dots_and_links(tree, monkeypatch):
    monkeypatch.chdir(tree)
    (tree / "up").symlink_to("..")
    parts = [part for part, _ in permissions.list_path_parts(tree / "a" / ".." / "up" / "case" / "case.toml")]
    assert parts == [*reversed(tree.parents), tree, tree / "a", tree / "up", tree, tree / "case.toml"]
    assert [part for part, _ in permissions.list_path_parts(type(tree)("case.toml"))][-1] == tree / "case.toml"


# --- a run that is resumed is the run that was begun -------------------------------------------------
@pytest.mark.parametrize("changed", ["inputs/fan.py", "inputs/new.csv", "case.toml"])
def test_a_checkpoint_counts_only_with_the_files_that_its_case_names(tree, tmp_path, changed):
    from flashtemp.errors import UserInterrupt

    def stop(progress, end):
        if progress.t > 0.3 * end:
            raise KeyboardInterrupt

    with pytest.raises(UserInterrupt):
        job.simulate(load_case(tree), tmp_path / "out", watch=stop)
    file = tmp_path / "out.partial" / changed
    file.write_text((file.read_text() if file.exists() else "") + "\n")
    with pytest.raises(BadInput, match=r"--resume: .*case\.toml or a file in inputs was changed since the run"):
        job.resume(tmp_path / "out")

import pytest

from benchctl.dashboard.web.sessions import Tokens


def test_one_token_signs_one_stops_runs_one_only_looks() -> None:
    tokens = Tokens()
    assert tokens.role_of(tokens.release_token) == "releaser"
    assert tokens.role_of(tokens.token) == "operator"
    assert tokens.role_of(tokens.view_token) == "viewer"


def test_where_nobody_may_stop_a_run_all_tokens_only_look() -> None:
    tokens = Tokens(read_only=True)
    all_three = (tokens.token, tokens.view_token, tokens.release_token)
    assert [tokens.role_of(text) for text in all_three] == ["viewer"] * 3


@pytest.mark.parametrize("shown", ["", " ", "ω", "a" * 43, "\x00"])
def test_anything_else_is_nobody(shown: str) -> None:
    assert Tokens().role_of(shown) is None


def test_a_part_of_a_token_is_nobody() -> None:
    tokens = Tokens()
    assert tokens.role_of(tokens.token[:-1]) is None
    assert tokens.role_of(f"{tokens.token}x") is None


def test_every_server_has_other_tokens_of_256_bits_and_never_shows_them_by_itself() -> None:
    made = [Tokens() for _ in range(100)]
    assert len({one for tokens in made for one in (tokens.token, tokens.view_token, tokens.release_token)}) == 300
    assert all(len(tokens.token) == 43 for tokens in made)
    assert made[0].token not in repr(made[0])

"""Threads of the linear algebra library.

Small matrices in several threads take many times as long on a busy machine as in one.
"""

from __future__ import annotations

from functools import cache, wraps
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    Decorated = TypeVar("Decorated", bound="Callable[..., Any]")


@cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()  # looks for libraries: milliseconds


def one_thread() -> Any:
    """Return a context in which linear algebra uses one thread."""
    return _controller().limit(limits=1, user_api="blas")


def in_one_thread(function: Decorated) -> Decorated:
    """Decorate a function so that its linear algebra uses one thread."""

    @wraps(function)
    def limited(*arguments: Any, **keywords: Any) -> Any:
        with one_thread():
            return function(*arguments, **keywords)

    return limited  # type: ignore[return-value]

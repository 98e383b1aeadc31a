"""Training of policies with Stable-Baselines3: the parts of `youbot train`.

Modules that need Stable-Baselines3 are imported after `require_learning`.
"""

from __future__ import annotations


def require_learning() -> None:
    """Refuse with one line where the extra is missing.

    Raises
    ------
    InputError
        If torch or Stable-Baselines3 cannot be imported.
    """
    from youbot_env.errors import InputError

    try:
        import stable_baselines3  # noqa: F401
    except ImportError:
        raise InputError(
            "training needs Stable-Baselines3 and torch: pip install 'youbot[rl]'"
        ) from None

"""The names under which gymnasium makes the task, known to it as soon as both it and the workbench
are in use.

Contract: nothing but strings is registered; what they name is imported when an environment is made.
"""

_ENVIRONMENTS = {
    "workbench/Follow-v0": ("FollowEnv", "FollowVectorEnv"),
    "workbench/FollowWheels-v0": ("follow_on_wheels", "follow_on_wheels_vector"),
}


def register() -> None:
    """Tell gymnasium of the environments, once."""
    import gymnasium

    for name, (single, many) in _ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            module = "workbench.envs.environments"
            gymnasium.register(
                name, entry_point=f"{module}:{single}", vector_entry_point=f"{module}:{many}"
            )

from .policy import Policy as Policy
from .policy_file import (
    load_policy as load_policy,
    save_policy as save_policy,
    shipped_policies as shipped_policies,
)

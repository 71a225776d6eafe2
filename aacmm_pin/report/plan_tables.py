"""A plan in tables for people: what was tried, and which pairs of causes are told worst."""

from __future__ import annotations

import pandas as pd

from aacmm_pin.planning import MeasurementPlan


def tried_table(plan: MeasurementPlan) -> pd.DataFrame:
    """The set-ups that were considered: T, the probability of telling the two causes apart, and why not."""
    return pd.DataFrame(
        [
            {
                "set-up": tried.words,
                "T": tried.power.least,
                "told with probability": "" if tried.why_not else f"{tried.power.probability:.2f}",
                "why not": tried.why_not,
            }
            for tried in plan.tried
        ]
    )


def pairs_table(plan: MeasurementPlan) -> pd.DataFrame:
    """Pairs of causes that postures can tell apart, worst told first; empty where the plan is for one pair."""
    if plan.pairs is None:
        return pd.DataFrame(columns=["cause", "from", "T", "told"])
    open_ = plan.pairs[plan.pairs["why_not"] == ""]
    return pd.DataFrame(
        {
            "cause": open_["cause"],
            "from": open_["other"],
            "T": open_["T"],
            "told": open_["told"],
        }
    ).reset_index(drop=True)

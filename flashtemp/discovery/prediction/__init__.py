"""Forward model of a campaign: what instruments show, with derivatives by every unknown."""

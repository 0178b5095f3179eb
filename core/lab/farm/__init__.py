"""Jobs for many machines: descriptions that schedulers read, and the join of what workers wrote."""

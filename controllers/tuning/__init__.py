"""Best gains within stability margins, tried on motions."""

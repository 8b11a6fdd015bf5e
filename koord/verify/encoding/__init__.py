"""Systems as Z3 terms: the rules on a symbolic domain, one round as one formula."""

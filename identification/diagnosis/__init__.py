"""Which physical effect a model lacks: candidates, search, verdict, next experiment."""

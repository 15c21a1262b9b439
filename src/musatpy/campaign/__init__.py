"""Many decks at once: batches of jobs in parallel processes, and baselines that later runs are held against.

result = run_batch(jobs_of_manifest("jobs.toml"), folder)
result.status, result.outcomes
"""

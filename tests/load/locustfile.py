"""What a dashboard and a script ask for: lists, single rows, metrics; two requests a second each, 25 of them."""

from __future__ import annotations

import random

from locust import FastHttpUser, task

# Of each client.
REQUESTS_PER_S = 2.0


class Reader(FastHttpUser):  # type: ignore[misc]
    """One client."""

    def wait_time(self) -> float:
        """Clients know nothing of each other: at a fixed pace the 25 that start together would ask together for
        ever, and each burst would wait for itself."""
        return random.expovariate(REQUESTS_PER_S)

    @task(4)
    def list_jobs(self) -> None:
        self.client.get("/v1/jobs?limit=50")

    @task(2)
    def follow_cursor(self) -> None:
        cursor = self.client.get("/v1/studies?limit=20").json().get("next_cursor")
        if cursor:
            self.client.get(f"/v1/studies?limit=20&cursor={cursor}", name="/v1/studies?cursor")

    @task(3)
    def read_study(self) -> None:
        self.client.get(f"/v1/studies/{random.randint(1, 10)}", name="/v1/studies/{id}")

    @task(2)
    def read_designs(self) -> None:
        number = random.randint(1, 10)
        self.client.get(f"/v1/studies/{number}/designs?limit=50", name="/v1/studies/{id}/designs")

    @task(1)
    def ready(self) -> None:
        self.client.get("/v1/health/ready")

"""Triggers that keep the record append-only, in the words of the database that the step runs on."""

from alembic import op

REFUSAL = "the record is append-only"


def on_server() -> bool:
    """Whether the store is on a PostgreSQL server."""
    return op.get_bind().dialect.name == "postgresql"


def refuse(verb: str, table: str, *, unless_removed: str | None = None) -> None:
    """Refuse UPDATE or DELETE of a table's rows; `unless_removed`: but for a campaign whose removal is on record.

    `unless_removed` names the column that has the campaign.
    """
    name = f"keep_{table}_{verb.lower()}"
    if not on_server():
        when = "" if unless_removed is None else _when_not_removed(unless_removed)
        op.execute(f"CREATE TRIGGER {name} BEFORE {verb} ON {table} {when}BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END")
        return
    _function(name, unless_removed)
    op.execute(f"CREATE TRIGGER {name} BEFORE {verb} ON {table} FOR EACH ROW EXECUTE FUNCTION {name}()")
    if verb == "DELETE":  # the way round row triggers
        _function(f"keep_{table}_truncate", None)
        op.execute(
            f"CREATE TRIGGER keep_{table}_truncate BEFORE TRUNCATE ON {table} "
            f"FOR EACH STATEMENT EXECUTE FUNCTION keep_{table}_truncate()"
        )


def allow(verb: str, table: str) -> None:
    """Take a refusal back, for the time of a step."""
    name = f"keep_{table}_{verb.lower()}"
    if not on_server():
        op.execute(f"DROP TRIGGER {name}")
        return
    op.execute(f"DROP TRIGGER {name} ON {table}")
    op.execute(f"DROP FUNCTION {name}()")
    if verb.lower() == "delete":
        op.execute(f"DROP TRIGGER keep_{table}_truncate ON {table}")
        op.execute(f"DROP FUNCTION keep_{table}_truncate()")


def _when_not_removed(column: str) -> str:
    return f"WHEN OLD.{column} NOT IN (SELECT campaign FROM removed_campaigns) "


def _function(name: str, unless_removed: str | None) -> None:
    """A function of its own for each trigger: PostgreSQL's WHEN can ask no other table."""
    exception = ""
    if unless_removed is not None:
        known = f"EXISTS (SELECT 1 FROM removed_campaigns r WHERE r.campaign = OLD.{unless_removed})"
        exception = f"IF {known} THEN RETURN OLD; END IF; "
    op.execute(
        f"CREATE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql SET search_path FROM CURRENT AS $$ "
        f"BEGIN {exception}RAISE EXCEPTION '{REFUSAL}' USING ERRCODE = 'integrity_constraint_violation'; END $$"
    )

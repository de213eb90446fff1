"""Debian's Chromium without a screen, and what a user does in it."""

import contextlib
import shutil

OFF = ("gpu", "quic", "background-networking", "component-update", "sync", "dev-shm-usage")
FLAGS = ("headless", "no-sandbox", "no-first-run", "window-size=1300,1000", *(f"disable-{one}" for one in OFF))
DRAWN = "return [...document.querySelectorAll('[data-figure]')].map(place => place.dataset.state)"


def missing() -> str:
    """Say what has to be installed, "" if nothing."""
    there = shutil.which("chromium") and shutil.which("chromedriver")
    return "" if there else "chromium or chromedriver is not installed (apt-get install chromium chromium-driver)"


@contextlib.contextmanager
def chromium(profile):
    """Chromium with a profile of its own, its log kept."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    for flag in (*FLAGS, f"user-data-dir={profile}"):
        options.add_argument(f"--{flag}")
    options.binary_location = shutil.which("chromium")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield browser
    finally:
        browser.quit()


def complaints(browser):
    """What the console says of errors and warnings."""
    return [line["message"] for line in browser.get_log("browser") if line["level"] in ("SEVERE", "WARNING")]


def click(browser, words):
    """Follow the first link with these words that can be seen."""
    from selenium.webdriver.common.by import By

    links = [one for one in browser.find_elements(By.PARTIAL_LINK_TEXT, words) if one.is_displayed()]
    assert links, f"no link {words!r} at {browser.current_url}"
    links[0].click()


def wait(browser, condition):
    """Wait until a function of the browser is true."""
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, 60, 0.05).until(condition)

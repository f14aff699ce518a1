*** Settings ***
Documentation     Sensor bring-up, six units streaming, the path of a sample from DRDY to the DAC.
Library           ForceBoard.py

*** Test Cases ***
Six Units Stream At Their Own Rates
    Power Up Board
    Advance    300
    Connect
    Bring Up Units
    Stream    1
    Samples Should Stream    2
    Codes Should Come From The Converters

Zeroing Takes The Offset Out
    Power Up Board    seed=3
    Advance    300
    Connect
    Bring Up Units
    Zero Units
    Advance    200
    ${status}=    Status
    FOR    ${unit}    IN    @{status}[units]
        Should Be True    abs(${unit}[tension_un]) < 30000
    END

Latency Agrees From Both Ends
    Armed Board
    Forget Samples
    Hold For    1000
    Latency Should Agree From Both Ends

Cables Come To Their Setpoint
    Armed Board    tension=5
    Hold For    1500
    Tensions Should Be    5    0.6
    Board State Should Be    running
    Disarm
    Advance    500
    Output Should Be Zero
    Board State Should Be    ready

Running Leaves The Log Quiet
    Create Log Tester    0
    Armed Board
    Hold For    300
    Disarm
    Advance    300
    # No warning at all, from any model, but for the one that is Renode's own (see boot.robot).
    Should Not Be In Log    ^(?!.*nvic: Unhandled write to offset 0xF50)    treatAsRegex=True    level=Warning

Another Tension On Each Cable
    Armed Board    seed=2
    Set Tensions    3    4    5    6    7    8
    Hold For    2000
    FOR    ${unit}    IN RANGE    1    7
        ${tension}=    True Tension    ${unit}
        Should Be True    abs(${tension} - ${unit} - 2) < 0.6
    END

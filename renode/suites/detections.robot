*** Settings ***
Documentation     Each detection of the firmware has a cause here that nothing else finds: `cargo xtask mutants --renode` switches the
...               detections off one at a time, and each time the test that is named there must fail.
Library           ForceBoard.py

*** Test Cases ***
Converters Are Calibrated
    Power Up Board
    Advance    300
    Connect
    Bring Up Units
    Advance    200
    # An offset that no calibration removed is 45,000 codes or more, what a calibration leaves has a deviation of 600.
    Codes Should Be Ideal Within    6000

Converter Too Slow
    Armed Board
    Execute Command    cell4 RateFactor 0.9
    Hold For    300
    Unit Fault Should Be    4    sensor too slow
    Output Should Be Zero    4
    Output Should Drive    1    2    3    5    6

Converter Too Fast
    Armed Board
    Execute Command    cell2 RateFactor 1.12
    Hold For    300
    Unit Fault Should Be    2    sensor too fast
    Output Should Be Zero    2
    Output Should Drive    1    3    4    5    6

ADC Saturated
    Armed Board
    Execute Command    rig PullCable 5 200
    Hold For    50
    Unit Fault Should Be    5    ADC saturated
    Output Should Be Zero    5

Encoder Stands Still
    # The watch of the plausible tension, which would find it before, is at its widest.
    Armed Board    plausible_un=20000000
    Execute Command    rig FreezeEncoder 5 true
    Execute Command    rig PullCable 5 6.5
    Hold For    60
    Unit Fault Should Be    5    encoder stands still
    Output Should Be Zero    5
    Board State Should Be    running
    # Nothing shows that the cable has let go.
    Hold For    100
    Board Fault Should Be    0 V has no effect
    Output Should Be Zero
    ${power}=    Execute Command    rig AmplifierOn
    Should Contain    ${power}    False

Configuration Changed In Memory
    # A number of the configuration that the sample path does not use: only the check of every second covers it.
    Power Up Board
    Advance    300
    Connect
    Bring Up Units    zero_deviation_un=765433
    Change In Memory    765433
    Advance    1200
    Board Fault Should Be    configuration damaged
    Output Should Be Zero

A Byte That Was Refused Does Not Begin The Next Transaction
    Create Log Tester    0
    Power Up Board
    Execute Command    i2c1 EarlyTransmitRequest true
    Execute Command    cell3 NackBytes 1
    Advance    300
    Connect
    Bring Up Units    within_ms=9000    again=${True}
    ${left}=    Number    cell3 NackBytes
    Should Be Equal As Integers    ${left}    0
    Should Not Be In Log    TXDR holds a byte    treatAsRegex=True

A Bus Error Is Cleared And Nothing Else
    Armed Board
    ${before}=    Status
    FOR    ${n}    IN RANGE    20
        Execute Command    i2c1 RaiseBusError
        Hold For    20
    END
    ${after}=    Status
    Should Be Equal As Integers    ${after}[bus_recoveries]    ${before}[bus_recoveries]
    Should Be Equal As Integers    ${after}[units][0][missed]    ${before}[units][0][missed]
    Board State Should Be    running

Lost Arbitration Is Recovered
    Armed Board
    ${before}=    Status
    Execute Command    i2c1 LoseArbitration true
    # One transaction in 500 us: it is over before the 300 us after which the firmware would give up a transaction.
    Hold For    100
    ${after}=    Status
    ${recoveries}=    Evaluate    $after['bus_recoveries'] - $before['bus_recoveries']
    Should Be Equal As Integers    ${recoveries}    1
    # The error interrupt ends the transaction. Without it the deadline would, 300 us after its beginning.
    ${released}=    Number    i2c1 ReleasedAfterUs
    Should Be True    ${released} < 100
    Board State Should Be    running
    Output Should Drive

Watchdog Resets Within Its Time While Interrupts Go On
    Armed Board
    Execute Command    rig HangLoop
    Advance    40
    ${resets}=    Number    rig Resets
    Should Be Equal As Integers    ${resets}    0
    Advance    25
    ${resets}=    Number    rig Resets
    Should Be Equal As Integers    ${resets}    1
    Output Should Be Zero

A Stage That Does Not Run Is Found By The Watchdog
    Armed Board
    Execute Command    rig SkipSamples
    Advance    70
    ${resets}=    Number    rig Resets
    Should Be Equal As Integers    ${resets}    1
    Output Should Be Zero
    Advance    300
    Connect
    Crash Record Should Be    watchdog reset

The DAC Link Stops
    Armed Board
    # No word leaves the controller any more.
    Execute Command    spi1 Stopped true
    Advance    5
    Output Should Be Zero
    Board Fault Should Be    DAC bus fault

A Register That Changes Is A Fault
    Armed Board
    # SPI1_CFG2 without MASTER.
    Execute Command    sysbus WriteDoubleWord 0x4001300C 0
    Advance    5
    Output Should Be Zero
    Board Fault Should Be    register changed

A Frame With A Wrong Checksum Is Dropped
    Power Up Board
    Advance    300
    Connect
    Run Keyword And Expect Error    no response*    Ask    GetStatus    damaged=${True}
    ${status}=    Status
    Should Be Equal As Integers    ${status}[frames_bad]    1
